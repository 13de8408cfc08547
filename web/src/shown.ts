// What is shown of a job: its labels at a cut, the clusters that they make, the hue of each, and the selected one. Cuts
// of a hierarchy are made here, once its merges are loaded; those of large meshes by the service.

import { type Job, type Labels, isHierarchical, json, labels, output } from "./api";
import { type Apart, Colouring, type Hued } from "./colouring";
import { Hierarchy, ofJob } from "./hierarchy";
import { HUES, css, ofHues } from "./palette";
import { type Clusters, measure } from "./table";
import type { Shown, Triangles } from "./drawable";
import { energyOf } from "./words";

/** Faces up to which cuts are made here. */
const MOST_FACES = 600_000;

/** What the service's table has of a cluster. */
export interface ClusterRow {
  perimeter: number | null;
  roundness: number | null;
  neighbours: number;
  energy: number | null;
}

export class Cuts {
  private hierarchy: Hierarchy | null = null;

  constructor(
    private readonly job: Job,
    private readonly signal: AbortSignal,
  ) {}

  /** Loads the merges, of a hierarchy that is not too large. */
  async load(): Promise<void> {
    const isSmall = (this.job.result?.faces ?? 0) <= MOST_FACES;
    if (!isHierarchical(this.job.parameters.algorithm) || !isSmall) return;
    this.hierarchy = await Hierarchy.read(ofJob(this.job, this.signal));
  }

  /** Labels at a cut that takes no request; null where it takes one. */
  now(clusters: number | null): Labels | null {
    return clusters === null ? null : (this.hierarchy?.cut(clusters) ?? null);
  }

  async at(clusters: number | null, signal: AbortSignal): Promise<Labels> {
    return this.now(clusters) ?? (await labels(this.job, clusters, signal));
  }
}

/** Labels in colours. */
export class Coloured {
  labels: Uint32Array = new Uint32Array();
  hues: Uint8Array = new Uint8Array();
  clusters: Clusters = measure(this.labels, null);
  private colours: Uint8Array | null = null;
  private colouring = new Colouring();
  private mesh: Triangles | null = null;

  /** With the mesh, hues are such that neighbours differ; clusters may keep those that they had before. */
  setMesh(mesh: Triangles, before: Coloured | null = null): void {
    this.mesh = mesh;
    this.colouring = new Colouring(mesh.corners, mesh.faces);
    if (before) this.colouring.follow(before.colouring);
  }

  /** Takes labels of a job, and of another one beside it, whose clusters have the hues of their counterparts. */
  setBoth(labels: Uint32Array, other: Coloured, others: Uint32Array): void {
    this.set(labels, null, { labels: others, colouring: other.colouring });
    other.set(others, this);
  }

  set(labels: Uint32Array, beside: Hued | null = null, apart: Apart | null = null): void {
    this.labels = labels;
    this.colours = null;
    let clusters = 0;
    for (let face = 0; face < labels.length; face++) clusters = Math.max(clusters, (labels[face] as number) + 1);
    this.hues = this.colouring.hues(labels, clusters, beside, apart);
  }

  /** Adds up faces, areas and centres; for a large mesh it takes longer than to draw it. */
  measure(): void {
    this.clusters = measure(this.labels, this.mesh);
  }

  /** The colour that a cluster is shown in. */
  css(cluster: number): string {
    const at = 4 * cluster;
    return css(this.colours?.subarray(at, at + 3) ?? HUES[this.hues[cluster] ?? 0] ?? [0, 0, 0]);
  }

  /** Labels with the given colours, or with hues. */
  shown(colours: Uint8Array | null): Shown {
    this.colours = colours;
    return { labels: this.labels, colours: colours ?? ofHues(this.hues) };
  }
}

/** Labels numbered by the first face that has them, as those of a result are. */
export function numbered(labels: Uint32Array): Uint32Array {
  const numbers = new Uint32Array(labels.length);
  let seen = 0;
  return labels.map((label) => (numbers[label] ||= ++seen) - 1);
}

/** The service's table of the clusters of a cut, fetched once. */
export class Rows {
  /** Those that were fetched. */
  now: ClusterRow[] | null = null;
  private cut: number | null = null;
  private coming: Promise<ClusterRow[]> | null = null;

  constructor(
    private readonly job: Job,
    private readonly signal: AbortSignal,
  ) {}

  /** Forgets the rows; the next ones are those of a cut. */
  cutAt(clusters: number | null): void {
    this.cut = clusters;
    this.now = this.coming = null;
  }

  fetch(): Promise<ClusterRow[]> {
    if (this.coming) return this.coming;
    const coming = this.get();
    this.coming = coming;
    coming.then(
      (rows) => this.coming === coming && (this.now = rows),
      () => {},
    );
    return coming;
  }

  /** Without energies where those of the job are others. */
  private async get(): Promise<ClusterRow[]> {
    const { job, signal, cut: clusters } = this;
    const path = output(job, "clusters", { format: "json", clusters });
    const { clusters: rows } = await json<{ clusters: ClusterRow[] }>(path, { signal });
    return energyOf(job) ? rows.map((row) => ({ ...row, energy: null })) : rows;
  }
}
