// Hues of clusters: neighbours never have the same one where eight suffice, and a cluster keeps its hue from one set of
// labels to the next, or takes that of another job's cluster. Clusters of a mesh are neighbours where they share a
// vertex.

import { HUES } from "./palette";

/** No hue yet. */
const NONE = 255;

/** Ends a list of labels. */
const FREE = 0xffffffff;

/** Labels at a vertex that one more label meets at most: the tip of a cone may have a label a face. */
const MOST_MET = 16;

/** Labels of another job and the hue of each of its clusters. */
export interface Hued {
  labels: Uint32Array;
  hues: Uint8Array;
}

/** Labels of another job, and what finds their neighbours. */
export interface Apart {
  labels: Uint32Array;
  colouring: Colouring;
}

export class Colouring {
  /** The first face and the hue of each cluster before. */
  private before: { face: number; hue: number }[] = [];
  /** The first cluster found at each vertex, and the place in `more` of the next one. */
  private readonly first: Uint32Array;
  private readonly then: Uint32Array;
  /** Labels and the place of the next one, in twos. */
  private more = new Uint32Array();
  /** Labels that meet at a vertex, in twos. */
  private pairs = new Uint32Array();

  constructor(
    /** The vertex of each corner; null where the mesh is not known. */
    private readonly corners: Uint32Array | null = null,
    /** The face of each triangle; null where every face is a triangle. */
    private readonly faces: Uint32Array | null = null,
  ) {
    let vertices = 0;
    for (const vertex of corners ?? []) if (vertex >= vertices) vertices = vertex + 1;
    this.first = new Uint32Array(vertices);
    this.then = new Uint32Array(vertices);
  }

  /** Goes on with the hues of another colouring of the same faces. */
  follow({ before }: Colouring): void {
    this.before = before;
  }

  /**
   * The hue of each cluster; `beside` another job that of its counterpart, where no neighbour has it. `apart` has another
   * job whose clusters will have the hues of these: they differ where clusters of that one are neighbours, too, and are
   * the same after a reload.
   */
  hues(labels: Uint32Array, clusters: number, beside: Hued | null = null, apart: Apart | null = null): Uint8Array {
    const hues = new Uint8Array(clusters).fill(NONE);
    const wanted = new Uint8Array(clusters).fill(NONE);
    let order: number[] = [];
    if (beside) {
      const [of, most] = counterparts(labels, clusters, beside.labels, beside.hues.length);
      wanted.set(of.map((other) => beside.hues[other] ?? NONE));
      order = [...most.keys()].sort((a, b) => (most[b] ?? 0) - (most[a] ?? 0));
    } else if (!apart)
      // a cluster goes on as the one that has its first face
      for (const { face, hue } of this.before) {
        const cluster = labels[face] ?? 0;
        if (wanted[cluster] === NONE) wanted[cluster] = hue;
      }
    const { starts, neighbours } = this.graph(labels, clusters, apart);
    const used = new Uint32Array(HUES.length);
    const total = new Uint32Array(HUES.length);
    const give = (cluster: number): void => {
      used.fill(0);
      for (let i = starts[cluster] ?? 0; i < (starts[cluster + 1] ?? 0); i++) {
        const hue = hues[neighbours[i] ?? 0] ?? NONE;
        if (hue !== NONE) used[hue] = (used[hue] ?? 0) + 1;
      }
      let best = wanted[cluster] ?? NONE;
      if (best === NONE || (used[best] ?? 0) > 0) {
        best = cluster % HUES.length;
        const cost = (hue: number): number => (used[hue] ?? 0) * 1e9 + (total[hue] ?? 0);
        for (let hue = 0; hue < HUES.length; hue++) if (cost(hue) < cost(best)) best = hue;
      }
      hues[cluster] = best;
      total[best] = (total[best] ?? 0) + 1;
    };
    // first those that keep a hue, then the others
    for (const cluster of order) give(cluster);
    for (let cluster = 0; cluster < clusters; cluster++) {
      if (wanted[cluster] !== NONE && hues[cluster] === NONE) give(cluster);
    }
    for (let cluster = 0; cluster < clusters; cluster++) if (hues[cluster] === NONE) give(cluster);
    this.before = [];
    for (let face = 0; face < labels.length && this.before.length < clusters; face++) {
      // labels are numbered by their first faces
      if (labels[face] === this.before.length) this.before.push({ face, hue: hues[labels[face] ?? 0] ?? NONE });
    }
    return hues;
  }

  /** Finds pairs of labels that meet at a vertex; gives the length of `pairs`. */
  protected meet(labels: Uint32Array): number {
    const { corners, faces, then } = this;
    const first = this.first.fill(FREE);
    if (!corners) return 0;
    let [count, used] = [0, 0];
    // this runs at every frame of a moving slider, and most triangles are inside of a cluster
    for (let i = 0, triangle = 0; i < corners.length; i += 3, triangle++) {
      const label = labels[faces ? (faces[triangle] as number) : triangle] as number;
      const a = corners[i] as number;
      const b = corners[i + 1] as number;
      const c = corners[i + 2] as number;
      if (first[a] === label && first[b] === label && first[c] === label) continue;
      for (const vertex of [a, b, c]) {
        const other = first[vertex] as number;
        if (other === label) continue;
        if (other === FREE) {
          first[vertex] = label;
          then[vertex] = FREE;
          continue;
        }
        // the label meets the last ones that were found there, the latest first
        const before = count;
        let at = then[vertex] as number;
        for (let i = 0; i < MOST_MET && at !== FREE && this.more[at] !== label; i++) {
          count = this.pair(this.more[at] as number, label, count);
          at = this.more[at + 1] as number;
        }
        if (at !== FREE && this.more[at] === label) {
          count = before;
          continue;
        }
        count = this.pair(other, label, count);
        if (used === this.more.length) this.more = grown(this.more);
        this.more[used] = label;
        this.more[used + 1] = then[vertex] as number;
        then[vertex] = used;
        used += 2;
      }
    }
    return count;
  }

  /** Adds a pair; gives the length of `pairs`. Clusters that share an edge are there twice, so they differ first. */
  protected pair(one: number, other: number, count: number): number {
    const { pairs } = this;
    if (count === pairs.length) this.pairs = grown(pairs);
    this.pairs[count] = one;
    this.pairs[count + 1] = other;
    return count + 2;
  }

  /** Neighbours of each cluster, those of cluster c from `starts[c]` on; some are there several times. */
  private graph(
    labels: Uint32Array,
    clusters: number,
    apart: Apart | null,
  ): { starts: Uint32Array; neighbours: Uint32Array } {
    let count = this.meet(labels);
    if (apart) {
      const { colouring, labels: others } = apart;
      const most = others.reduce((a, b) => Math.max(a, b), 0) + 1;
      const [of] = counterparts(others, most, labels, clusters);
      for (let i = 0, end = colouring.meet(others); i < end; i += 2) {
        const [one, other] = [of[colouring.pairs[i] ?? 0] ?? 0, of[colouring.pairs[i + 1] ?? 0] ?? 0];
        if (one !== other) count = this.pair(one, other, count);
      }
    }
    const { pairs } = this;
    const starts = new Uint32Array(clusters + 1);
    for (let i = 0; i < count; i++) {
      const next = (pairs[i] ?? 0) + 1;
      starts[next] = (starts[next] ?? 0) + 1;
    }
    for (let cluster = 0; cluster < clusters; cluster++)
      starts[cluster + 1] = (starts[cluster + 1] ?? 0) + (starts[cluster] ?? 0);
    const ends = starts.slice();
    const neighbours = new Uint32Array(count);
    for (let i = 0; i < count; i++) {
      const cluster = pairs[i] ?? 0;
      const at = ends[cluster] ?? 0;
      neighbours[at] = pairs[i ^ 1] ?? 0;
      ends[cluster] = at + 1;
    }
    return { starts, neighbours };
  }
}

/** Twice as long. */
function grown(numbers: Uint32Array): Uint32Array<ArrayBuffer> {
  const longer = new Uint32Array(2 * numbers.length + 1024);
  longer.set(numbers);
  return longer;
}

/** The cluster of other labels that has most faces in common with each cluster, and how many these are. */
function counterparts(
  labels: Uint32Array,
  clusters: number,
  others: Uint32Array,
  most: number,
): [Uint32Array, Uint32Array] {
  const common = new Map<number, number>();
  for (let face = 0; face < labels.length; face++) {
    const both = (labels[face] ?? 0) * most + (others[face] ?? 0);
    common.set(both, (common.get(both) ?? 0) + 1);
  }
  const [of, faces] = [new Uint32Array(clusters), new Uint32Array(clusters)];
  for (const [both, count] of common) {
    const cluster = Math.floor(both / most);
    if (count <= (faces[cluster] ?? 0)) continue;
    faces[cluster] = count;
    of[cluster] = both % most;
  }
  return [of, faces];
}
