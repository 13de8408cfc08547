// Up and down the tree of a hierarchy: from a cluster of a cut to the cluster that it becomes a part of, or to the
// two that it was made of. Merge i makes node n + i of n faces and leaves n − i − 1 clusters, so the number of a node
// says where to cut: there with the node as a whole, at one cluster more with its two parts.

import { type Job, json, output } from "./api";

/** The clusters of a cut as nodes of the tree, in the order of their labels. */
export interface CutNodes {
  nodes: number[];
  parents: (number | null)[];
}

export interface Step {
  /** The cut that it leads to. */
  clusters: number;
  /** Labels there: one upwards, two downwards. */
  parts: number[];
}

export async function nodesAt(job: Job, clusters: number, signal: AbortSignal): Promise<CutNodes> {
  const path = output(job, "hierarchy", { format: "json", clusters, max_clusters: 0 });
  return (await json<{ cut: CutNodes }>(path, { signal })).cut;
}

/** A step from a cluster of a cut; null where the tree ends. */
export async function climb(
  job: Job,
  faces: number,
  clusters: number,
  cluster: number,
  isUp: boolean,
  signal: AbortSignal,
): Promise<Step | null> {
  const { nodes, parents } = await nodesAt(job, clusters, signal);
  const node = (isUp ? parents : nodes)[cluster] ?? null;
  if (node === null || node < faces) return null;
  const target = isUp ? 2 * faces - node - 1 : 2 * faces - node;
  const there = await nodesAt(job, target, signal);
  const isPart = (label: number): boolean => (isUp ? there.nodes : there.parents)[label] === node;
  return { clusters: target, parts: [...there.nodes.keys()].filter(isPart) };
}
