// Steps in the tree of a hierarchy: from the selected cluster up or down, or to a node of the picture of the tree.

import type { Job } from "./api";
import { type CutNodes, climb, nodesAt } from "./climb";
import { Dendrogram } from "./dendrogram";
import { announce } from "./dom";

/** A cut and the cluster that is selected there. */
export interface Where {
  cut: number | null;
  selected: number | null;
}

export class Walk {
  readonly tree: Dendrogram;
  /** The clusters of a cut as nodes of the tree. */
  private nodes: { cut: number; found: Promise<CutNodes> } | null = null;

  constructor(
    private readonly job: Job,
    private readonly where: () => Where,
    /** Cuts where some clusters are, and selects the largest of them. */
    private readonly goTo: (clusters: number, labels: number[]) => Promise<void>,
    private readonly onFail: (error: unknown) => void,
    private readonly signal: AbortSignal,
  ) {
    this.tree = new Dendrogram(job, signal);
    this.tree.onChoose = (node, clusters) => void this.visit(node, clusters).catch(this.onFail);
    this.tree.onShow = () => this.mark();
  }

  /** Goes up or down from the selected cluster. */
  async step(isUp: boolean): Promise<void> {
    const { cut, selected } = this.where();
    if (cut === null || selected === null) return;
    const step = await climb(this.job, this.job.result?.faces ?? 0, cut, selected, isUp, this.signal);
    if (this.where().cut !== cut || this.where().selected !== selected) return;
    if (!step) return announce(isUp ? "The hierarchy ends with this cluster." : "A single face cannot be split.");
    await this.goTo(step.clusters, step.parts);
  }

  /** Marks the cut and the selected cluster in the picture of the tree. */
  mark(): void {
    void this.find().catch(this.onFail);
  }

  private async find(): Promise<void> {
    const { cut, selected } = this.where();
    if (cut === null) return;
    this.tree.mark(cut, null);
    if (selected === null || !this.tree.has(cut)) return;
    if (this.nodes?.cut !== cut) this.nodes = { cut, found: nodesAt(this.job, cut, this.signal) };
    const { nodes } = await this.nodes.found;
    if (this.where().cut === cut && this.where().selected === selected) this.tree.mark(cut, nodes[selected] ?? null);
  }

  /** Cuts where a node is a cluster, and selects it. */
  private async visit(node: number, clusters: number): Promise<void> {
    const { nodes } = await nodesAt(this.job, clusters, this.signal);
    await this.goTo(clusters, [nodes.indexOf(node)]);
  }
}
