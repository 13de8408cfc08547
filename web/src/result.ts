// What a job gave: the mesh in 3D, cuts of a hierarchy, a cluster and its numbers, a comparison with another job of the
// same mesh, the remesh, the table, the files.

import * as address from "./address";
import { type Job, type Labels, type Report, isHierarchical, json, labels, output, request } from "./api";
import { climb } from "./climb";
import { Comparison } from "./compare";
import { dendrogram } from "./dendrogram";
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
  private view: View | null = null;
  private mesh: Triangles | null = null;
  private mine: Labels | null = null;
  /** Labels of the job that is compared. */
  private others: Labels | null = null;
  private other: string | null = null;
  private clusters: Clusters | null = null;
  private cut: number | null = null;
  private selected: number | null = null;
  private rows: Promise<ClusterRow[]> | null = null;
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
    this.comparison.onChoose = (other) => {
      this.other = other;
      address.amend({ with: other });
      void this.fetchLabels().catch((error) => this.fail(error));
    };
    const list = make("details", {}, make("summary", {}, "Table of clusters"));
    this.table = new ClusterTable(list);
    this.table.onSelect = (cluster) => this.select(cluster === this.selected ? null : cluster);
    const tree = make("div", { class: "tools" }, this.up, this.down);
    box.replaceChildren(...(this.level ? [this.level.element] : []), this.figure, this.picked);
    box.append(...(this.level ? [tree] : []), this.comparison.element);
    rest.replaceChildren(
      this.energies,
      list,
      ...(this.level ? [dendrogram(job, this.abort.signal)] : []),
      downloads(job, () => this.cut, this.abort.signal),
    );
  }

  async load(): Promise<void> {
    const { signal } = this.abort;
    // before anything is shown, which changes the address
    const { cluster, with: other } = address.read();
    const report = await json<Report>(output(this.job, "report"), { signal });
    this.showEnergies(report);
    await this.comparison.offer(signal);
    this.other = other;
    await this.fetchLabels();
    if (!this.job.keep_mesh)
      this.figure.replaceChildren("The mesh was not kept with this job, so there is nothing to draw.");
    else if (report.input.triangles > MANY_TRIANGLES) this.figure.replaceChildren(this.later(report.input.triangles));
    else await this.draw();
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
      onclick: () => void this.draw().catch((error) => this.fail(error)),
    });
    start.textContent = `Show ${count(triangles)} triangles in 3D`;
    return start;
  }

  private async draw(): Promise<void> {
    const path = output(this.job, "mesh", { format: "glb", colours: "none", clusters: this.cut });
    this.figure.setAttribute("aria-busy", "true");
    this.mesh = await this.scene.triangles(await this.bytes(path));
    this.abort.signal.throwIfAborted();
    const view = new this.scene.View(this.figure, this.mesh);
    this.view = view;
    view.canvas.setAttribute("role", "img");
    view.canvas.setAttribute(
      "aria-label",
      "The mesh with its clusters. Arrow keys turn it, plus and minus zoom, 0 resets. The table has the same clusters.",
    );
    view.onPick = (triangle, isUp) => {
      const shown = this.shown();
      const face = triangle === null ? null : (this.mesh?.faces?.[triangle] ?? triangle);
      const cluster = face === null || !shown ? null : (shown.numbers[face] ?? null);
      // the first click selects; the next one goes down the tree, or with Shift up
      const isAgain = cluster !== null && cluster === this.selected;
      if (isAgain && this.level) this.go(isUp);
      else this.select(cluster);
    };
    this.figure.removeAttribute("aria-busy");
    this.box.querySelector("#overlay")?.remove();
    if (this.job.urls["remesh"]) this.picked.before(this.overlay());
    this.show();
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
    if (cut === null || selected === null || this.others || !this.level) return;
    const step = await climb(job, job.result?.faces ?? 0, cut, selected, isUp, this.abort.signal);
    if (this.cut !== cut || this.selected !== selected) return;
    if (!step) return announce(isUp ? "The hierarchy ends with this cluster." : "A single face cannot be split.");
    clearTimeout(this.timer);
    this.cut = step.clusters;
    this.level.set(step.clusters);
    address.amend({ clusters: step.clusters });
    await this.fetchLabels();
    const { faces } = this.clusters ?? { faces: new Uint32Array() };
    const largest = step.parts.reduce((a, b) => ((faces[b] ?? 0) > (faces[a] ?? 0) ? b : a));
    if (this.cut === step.clusters) this.select(largest);
  }

  /** Fetches the labels at the cut; an answer that comes after a later move is dropped. */
  private async fetchLabels(): Promise<void> {
    this.cutting.abort();
    const cutting = new AbortController();
    this.cutting = cutting;
    try {
      this.mine = await labels(this.job, this.cut, cutting.signal);
      this.others = await this.comparison.show(this.other, this.cut, cutting.signal);
    } catch (error) {
      if (cutting.signal.aborted) return;
      throw error;
    }
    this.rows = null;
    this.show();
    if (this.edges?.checked) await this.showRemesh(true);
  }

  private shown(): Labels | null {
    return this.others ?? this.mine;
  }

  private show(): void {
    const shown = this.shown();
    if (!shown) return;
    this.clusters = measure(shown.numbers, this.mesh);
    this.table.show(this.clusters);
    this.view?.setLabels(shown.numbers);
    this.level?.tell(this.mine?.energy ? `energy ${digits(this.mine.energy)}` : "");
    this.comparison.tell(this.mine?.energy ?? this.final, this.others?.energy ?? null);
    if (this.selected !== null && this.selected >= this.clusters.faces.length) this.select(null);
    else this.select(this.selected);
    this.figure.dataset["clusters"] = String(this.clusters.faces.length);
  }

  private select(cluster: number | null): void {
    const has = cluster !== null && this.clusters !== null && cluster < this.clusters.faces.length;
    const changed = this.selected !== cluster;
    this.selected = has ? cluster : null;
    address.amend({ cluster: this.selected });
    this.view?.select(this.selected);
    this.table.select(this.selected);
    this.picked.textContent = this.numbers();
    this.up.disabled = this.down.disabled = this.selected === null || this.others !== null;
    if (changed) announce(this.picked.textContent);
    if (this.selected !== null) void this.tellMore(this.selected).catch((error) => this.fail(error));
  }

  /** Adds what the service's table of clusters has beyond the page's own numbers; of this job's labels only. */
  private async tellMore(cluster: number): Promise<void> {
    if (!this.job.urls["clusters"] || this.others) return;
    this.rows ??= json<{ clusters: ClusterRow[] }>(
      output(this.job, "clusters", { format: "json", clusters: this.cut }),
      { signal: this.abort.signal },
    ).then(({ clusters }) => clusters);
    const row = (await this.rows)[cluster];
    if (!row || this.selected !== cluster || this.others) return;
    const [neighbours, energy] = [count(row.neighbours), digits(row.energy ?? NaN)];
    const shape = `perimeter ${digits(row.perimeter ?? NaN)}, roundness ${digits(row.roundness ?? NaN)}`;
    this.picked.textContent = `${this.numbers()}, ${shape}, ${neighbours} neighbours, energy ${energy}`;
  }

  /** The numbers of the selected cluster. */
  private numbers(): string {
    const { clusters, selected } = this;
    if (!clusters || selected === null) {
      const tree = this.level ? " A second click on it splits it, one with Shift merges it." : "";
      return `No cluster is selected. Click on one, or take one from the table.${tree}`;
    }
    const faces = `cluster ${selected}: ${count(clusters.faces[selected] ?? 0)} faces`;
    if (!this.mesh) return faces;
    const centre = clusters.centres.slice(3 * selected, 3 * selected + 3);
    return `${faces}, area ${digits(clusters.area[selected] ?? 0)}, centre ${Array.from(centre, digits).join(", ")}`;
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
