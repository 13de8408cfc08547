// Hues of clusters: neighbours never have the same one where eight suffice, and a cluster keeps its hue from one set of
// labels to the next. Clusters of a mesh are neighbours where they share a vertex.

import { HUES } from "./palette";

/** No hue yet. */
const NONE = 255;

export class Colouring {
  /** The first face and the hue of each cluster before. */
  private before: { face: number; hue: number }[] = [];
  /** The first cluster found at each vertex. */
  private readonly first: Uint32Array;
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
  }

  /** The hue of each cluster. */
  hues(labels: Uint32Array, clusters: number): Uint8Array {
    const hues = new Uint8Array(clusters).fill(NONE);
    const wanted = new Uint8Array(clusters).fill(NONE);
    // a cluster goes on as the one that has its first face
    for (const { face, hue } of this.before) {
      const cluster = labels[face] ?? 0;
      if (wanted[cluster] === NONE) wanted[cluster] = hue;
    }
    const { starts, neighbours } = this.graph(labels, clusters);
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
    for (let cluster = 0; cluster < clusters; cluster++) if (wanted[cluster] !== NONE) give(cluster);
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
    const { corners, faces } = this;
    const first = this.first.fill(0xffffffff);
    const length = corners?.length ?? 0;
    let count = 0;
    // plain loops: this runs at every frame of a moving slider
    for (let corner = 0, triangle = 0; corner < length; triangle++) {
      const label = labels[faces ? (faces[triangle] ?? 0) : triangle] ?? 0;
      for (const end = corner + 3; corner < end; corner++) {
        const vertex = corners?.[corner] ?? 0;
        const other = first[vertex] ?? 0;
        if (other === 0xffffffff) first[vertex] = label;
        else if (other !== label) count = this.pair(other, label, count);
      }
    }
    return count;
  }

  /** Adds a pair, unless it is the last one; gives the length of `pairs`. */
  protected pair(one: number, other: number, count: number): number {
    const { pairs } = this;
    // the triangles around a vertex often follow each other
    if (count > 0 && pairs[count - 2] === one && pairs[count - 1] === other) return count;
    if (count === pairs.length) (this.pairs = new Uint32Array(2 * count + 1024)).set(pairs);
    this.pairs[count] = one;
    this.pairs[count + 1] = other;
    return count + 2;
  }

  /** Neighbours of each cluster, those of cluster c from `starts[c]` on; some are there several times. */
  private graph(labels: Uint32Array, clusters: number): { starts: Uint32Array; neighbours: Uint32Array } {
    const count = this.meet(labels);
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
