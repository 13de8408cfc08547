// What a job gave: the mesh in 3D, cuts of a hierarchy, a cluster and its numbers, a comparison with another job of the
// same mesh, the remesh, the table, the files.

import * as address from "./address";
import { type Job, type Labels, type Report, isHierarchical, json, labels, output, request } from "./api";
import { type CutNodes, climb, nodesAt } from "./climb";
import { Comparison, counterpart, overlap } from "./compare";
import { Dendrogram } from "./dendrogram";
import { announce, count, digits, make, notice } from "./dom";
import { downloads } from "./downloads";
import { Level } from "./level";
import type { Scene } from "./load";
import { ClusterTable, type Clusters, measure } from "./table";
import type { Triangles, View } from "./view";

/** Triangles above which 3D waits for a click: 36 bytes each on the graphics processor, and twice that here. */
const MANY_TRIANGLES = 5_000_000;

/** Time without a move of the slider after which labels are fetched, in milliseconds. */
const REST = 80;

/** Clusters that a hierarchy is shown at first. */
const FIRST_CUT = 100;

/** What the page shows of a row of the service's table of clusters. */
interface ClusterRow {
  perimeter: number | null;
  roundness: number | null;
  neighbours: number;
  energy: number | null;
}

export class Result {
  private readonly abort = new AbortController();
  private cutting = new AbortController();
  private readonly figure = make("div", { id: "view", class: "view" });
  private readonly picked = make("p", { id: "picked" }, "No cluster is selected.");
  private readonly energies = make("dl", { id: "energies" });
  private readonly up = make("button", { type: "button", id: "up", onclick: () => this.go(true) }, "Merge it, upwards");
  private readonly down = make("button", { type: "button", id: "down", onclick: () => this.go(false) }, "Split it");
  private readonly comparison: Comparison;
  private readonly table: ClusterTable;
  private readonly level: Level | null;
  private readonly tree: Dendrogram | null;
  private view: View | null = null;
  private mesh: Triangles | null = null;
  private mine: Labels | null = null;
  private clusters: Clusters | null = null;
  private cut: number | null = null;
  private selected: number | null = null;
  /** The selected cluster of the job that is beside this one. */
  private beside: number | null = null;
  private rows: Promise<ClusterRow[]> | null = null;
  /** The clusters of the cut as nodes of the tree. */
  private nodes: Promise<CutNodes> | null = null;
  /** Energy of a flat job's labels. */
  private final: number | null = null;
  private edges: HTMLInputElement | null = null;
  private timer = 0;

  constructor(
    private readonly box: HTMLElement,
    rest: HTMLElement,
    private readonly job: Job,
    private readonly scene: Scene,
  ) {
    this.level = isHierarchical(job.parameters.algorithm) ? this.slider() : null;
    this.comparison = new Comparison(job);
    this.comparison.onChoose = () => void this.fetchLabels().catch((error) => this.fail(error));
    this.comparison.onArrange = () => this.show();
    this.tree = this.level && new Dendrogram(job, this.abort.signal);
    if (this.tree) {
      this.tree.onChoose = (node, clusters) => void this.visit(node, clusters).catch((error) => this.fail(error));
      this.tree.onShow = () => void this.markNode().catch((error) => this.fail(error));
    }
    const list = make("details", {}, make("summary", {}, "Table of clusters"));
    this.table = new ClusterTable(list);
    this.table.onSelect = (cluster) => this.select(cluster === this.selected ? null : cluster);
    const steps = make("div", { class: "tools" }, this.up, this.down);
    box.replaceChildren(...(this.level ? [this.level.element] : []), this.figure, this.comparison.captions);
    box.append(this.picked, ...(this.level ? [steps] : []), this.comparison.element);
    rest.replaceChildren(
      this.energies,
      list,
      ...(this.tree ? [this.tree.element] : []),
      downloads(job, () => this.cut, this.abort.signal),
    );
  }

  async load(): Promise<void> {
    const { signal } = this.abort;
    // before anything is shown, which changes the address
    const { cluster } = address.read();
    const report = await json<Report>(output(this.job, "report"), { signal });
    this.showEnergies(report);
    const { triangles } = report.input;
    // on its way while everything else is fetched
    const mesh = this.job.keep_mesh && triangles <= MANY_TRIANGLES ? this.fetchMesh() : null;
    mesh?.catch(() => {});
    await this.comparison.offer(signal);
    await this.fetchLabels();
    if (mesh) await this.draw(mesh);
    else if (this.job.keep_mesh) this.figure.replaceChildren(this.later(triangles));
    else this.figure.replaceChildren("The mesh was not kept with this job, so there is nothing to draw.");
    if (cluster !== null) this.select(cluster);
  }

  close(): void {
    clearTimeout(this.timer);
    this.abort.abort();
    this.cutting.abort();
    this.view?.dispose();
  }

  private later(triangles: number): HTMLElement {
    const start = make("button", {
      type: "button",
      onclick: () => void this.draw(this.fetchMesh()).catch((error) => this.fail(error)),
    });
    start.textContent = `Show ${count(triangles)} triangles in 3D`;
    return start;
  }

  private async fetchMesh(): Promise<ArrayBuffer> {
    return await this.bytes(output(this.job, "mesh", { format: "glb", colours: "none", clusters: this.cut }));
  }

  private async draw(bytes: Promise<ArrayBuffer>): Promise<void> {
    this.figure.setAttribute("aria-busy", "true");
    const mesh = await this.scene.triangles(await bytes);
    this.abort.signal.throwIfAborted();
    this.mesh = mesh;
    const view = new this.scene.View(this.figure, mesh);
    this.view = view;
    view.canvas.setAttribute("role", "img");
    view.canvas.setAttribute(
      "aria-label",
      "The mesh with its clusters. Arrow keys turn it, plus and minus zoom, 0 resets. The table has the same clusters.",
    );
    view.onPick = (triangle, isUp, pane) => this.pick(triangle, isUp, pane === 1);
    this.figure.removeAttribute("aria-busy");
    this.box.querySelector("#overlay")?.remove();
    if (this.job.urls["remesh"]) this.picked.before(this.overlay());
    this.paint();
    // what follows takes a while for a large mesh, which is drawn meanwhile
    await new Promise(requestAnimationFrame);
    if (!this.abort.signal.aborted) this.tell();
  }

  /** The first click on a cluster selects it; the next one goes down the tree, or with Shift up. */
  private pick(triangle: number | null, isUp: boolean, isBeside: boolean): void {
    const [shown, others] = [this.shown()?.numbers, this.comparison.labels?.numbers];
    const face = triangle === null ? null : (this.mesh?.faces?.[triangle] ?? triangle);
    const cluster = face === null ? null : ((isBeside ? others : shown)?.[face] ?? null);
    if (isBeside && shown && others)
      this.select(cluster === null ? null : counterpart(others, shown, cluster), cluster);
    else if (cluster !== null && cluster === this.selected && this.level) this.go(isUp);
    else this.select(cluster);
  }

  private slider(): Level {
    const { clusters: least = 1, faces: most = 1 } = this.job.result ?? {};
    const level = new Level(least, most, (clusters) => {
      this.cut = clusters;
      address.amend({ clusters });
      clearTimeout(this.timer);
      this.timer = window.setTimeout(() => void this.fetchLabels().catch((error) => this.fail(error)), REST);
    });
    this.cut = level.within(address.read().clusters ?? this.job.parameters.clusters ?? FIRST_CUT);
    level.set(this.cut);
    return level;
  }

  /** Goes up or down the tree from the selected cluster. */
  private go(isUp: boolean): void {
    void this.step(isUp).catch((error) => this.fail(error));
  }

  private async step(isUp: boolean): Promise<void> {
    const { cut, selected, job } = this;
    if (cut === null || selected === null || this.comparison.isReplaced) return;
    const step = await climb(job, job.result?.faces ?? 0, cut, selected, isUp, this.abort.signal);
    if (this.cut !== cut || this.selected !== selected) return;
    if (!step) return announce(isUp ? "The hierarchy ends with this cluster." : "A single face cannot be split.");
    await this.cutAt(step.clusters, step.parts);
  }

  /** Cuts where a node of the tree is a cluster, and selects it. */
  private async visit(node: number, clusters: number): Promise<void> {
    const { nodes } = await nodesAt(this.job, clusters, this.abort.signal);
    await this.cutAt(clusters, [nodes.indexOf(node)]);
  }

  /** Cuts the hierarchy, and selects the largest of some clusters there. */
  private async cutAt(clusters: number, labels: number[]): Promise<void> {
    clearTimeout(this.timer);
    this.cut = clusters;
    this.level?.set(clusters);
    address.amend({ clusters });
    await this.fetchLabels();
    const { faces } = this.clusters ?? { faces: new Uint32Array() };
    const largest = labels.reduce((a, b) => ((faces[b] ?? 0) > (faces[a] ?? 0) ? b : a));
    if (this.cut === clusters && !this.comparison.isReplaced) this.select(largest);
  }

  /** Marks the cut and the selected cluster in the picture of the tree. */
  private async markNode(): Promise<void> {
    const { cut, selected, tree } = this;
    if (!tree || cut === null) return;
    tree.mark(cut, null);
    if (selected === null || this.comparison.isReplaced || !tree.has(cut)) return;
    this.nodes ??= nodesAt(this.job, cut, this.abort.signal);
    const { nodes } = await this.nodes;
    if (this.cut === cut && this.selected === selected) tree.mark(cut, nodes[selected] ?? null);
  }

  /** Fetches the labels at the cut; an answer that comes after a later move is dropped. */
  private async fetchLabels(): Promise<void> {
    this.cutting.abort();
    const cutting = new AbortController();
    this.cutting = cutting;
    try {
      this.mine = await labels(this.job, this.cut, cutting.signal);
      await this.comparison.fetch(this.cut, cutting.signal);
    } catch (error) {
      if (cutting.signal.aborted) return;
      throw error;
    }
    this.rows = this.nodes = null;
    this.show();
    if (this.edges?.checked) await this.showRemesh(true);
  }

  /** The labels of which the table and the numbers are. */
  private shown(): Labels | null {
    return this.comparison.isReplaced ? this.comparison.labels : this.mine;
  }

  private show(): void {
    this.paint();
    this.tell();
  }

  private paint(): void {
    const shown = this.shown();
    if (!shown) return;
    this.view?.setLabels(shown.numbers, this.comparison.isBeside ? this.comparison.labels?.numbers : null);
  }

  /** Everything but the picture. */
  private tell(): void {
    const shown = this.shown();
    if (!shown) return;
    this.clusters = measure(shown.numbers, this.mesh);
    this.table.show(this.clusters);
    this.level?.tell(this.mine?.energy ? `energy ${digits(this.mine.energy)}` : "");
    this.comparison.tell(this.mine?.energy ?? this.final);
    if (this.selected !== null && this.selected >= this.clusters.faces.length) this.select(null);
    else this.select(this.selected);
    this.figure.dataset["clusters"] = String(this.clusters.faces.length);
  }

  /** Selects a cluster, and of the job beside it the given one, or that which has most of its faces. */
  private select(cluster: number | null, beside: number | null = null): void {
    const has = cluster !== null && this.clusters !== null && cluster < this.clusters.faces.length;
    const changed = this.selected !== cluster;
    this.selected = has ? cluster : null;
    const [mine, others] = [this.mine?.numbers, this.comparison.labels?.numbers];
    const hasBeside = this.selected !== null && this.comparison.isBeside && mine && others;
    this.beside = hasBeside ? (beside ?? counterpart(mine, others, this.selected ?? 0)) : null;
    address.amend({ cluster: this.selected });
    this.view?.select(this.selected, this.beside);
    this.table.select(this.selected);
    this.picked.textContent = this.numbers();
    this.up.disabled = this.down.disabled = this.selected === null || this.comparison.isReplaced;
    if (changed) announce(this.picked.textContent);
    if (this.selected !== null) void this.tellMore(this.selected).catch((error) => this.fail(error));
    void this.markNode().catch((error) => this.fail(error));
  }

  /** Adds what the service's table of clusters has beyond the page's own numbers; of this job's labels only. */
  private async tellMore(cluster: number): Promise<void> {
    if (!this.job.urls["clusters"] || this.comparison.isReplaced) return;
    this.rows ??= json<{ clusters: ClusterRow[] }>(
      output(this.job, "clusters", { format: "json", clusters: this.cut }),
      { signal: this.abort.signal },
    ).then(({ clusters }) => clusters);
    const row = (await this.rows)[cluster];
    if (!row || this.selected !== cluster || this.comparison.isReplaced) return;
    const [neighbours, energy] = [count(row.neighbours), digits(row.energy ?? NaN)];
    const shape = `perimeter ${digits(row.perimeter ?? NaN)}, roundness ${digits(row.roundness ?? NaN)}`;
    this.picked.textContent = this.numbers(`, ${shape}, ${neighbours} neighbours, energy ${energy}`);
  }

  /** The numbers of the selected cluster, and of the one beside it. */
  private numbers(more = ""): string {
    const { clusters, selected, beside } = this;
    if (!clusters || selected === null) {
      const tree = this.level ? " A second click on it splits it, one with Shift merges it." : "";
      return `No cluster is selected. Click on one, or take one from the table.${tree}`;
    }
    const [mine, others] = [this.mine?.numbers, this.comparison.labels?.numbers];
    const pair = beside !== null && mine && others ? `; ${overlap(mine, selected, others, beside)}` : "";
    const faces = `cluster ${selected}: ${count(clusters.faces[selected] ?? 0)} faces`;
    if (!this.mesh) return faces + pair;
    const centre = Array.from(clusters.centres.slice(3 * selected, 3 * selected + 3), digits).join(", ");
    return `${faces}, area ${digits(clusters.area[selected] ?? 0)}, centre ${centre}${more}${pair}`;
  }

  private overlay(): HTMLElement {
    const box = make("input", { type: "checkbox", id: "remesh" });
    this.edges = box;
    box.addEventListener("change", () => void this.showRemesh(box.checked).catch((error) => this.fail(error)));
    return make(
      "p",
      { id: "overlay" },
      box,
      make("label", { for: "remesh" }, "edges of the remesh, a vertex a cluster"),
    );
  }

  private async bytes(path: string): Promise<ArrayBuffer> {
    return await (await request(path, { signal: this.abort.signal })).arrayBuffer();
  }

  private async showRemesh(isOn: boolean): Promise<void> {
    if (!isOn) return this.view?.setLines(null);
    const path = output(this.job, "remesh", { format: "glb", clusters: this.cut });
    const { segments, centre } = await this.scene.edges(await this.bytes(path));
    this.view?.setLines(segments, centre);
    this.figure.dataset["edges"] = String(segments.length / 6);
  }

  private showEnergies(report: Report): void {
    const { initial, final, hexagon_ratio: ratio } = report.energy;
    const rows: [string, string][] = [["faces", count(report.input.faces)]];
    // of a whole hierarchy they are those of its roots
    const isFlat = !this.level || this.job.parameters.clusters;
    if (isFlat) this.final = final;
    if (initial !== null && initial !== undefined) rows.push(["energy at the start", digits(initial)]);
    if (isFlat && final !== null && final !== undefined) rows.push(["energy at the end", digits(final)]);
    if (isFlat && ratio !== null && ratio !== undefined) rows.push(["of a tiling with hexagons", ratio.toFixed(4)]);
    rows.push(["clustered in", `${digits(report.timings_ms["cluster"] ?? 0)} ms`]);
    this.energies.replaceChildren(
      ...rows.map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value))),
    );
    for (const warning of report.warnings) this.energies.after(make("p", { class: "warning" }, warning));
  }

  private fail(error: unknown): void {
    if (!this.abort.signal.aborted) notice(error instanceof Error ? error.message : String(error));
  }
}
