// What a job gave: the mesh in 3D, a slider over the clusters of a hierarchy, a cluster and its numbers, a comparison
// with another job of the same mesh, the remesh, the table, the files.

import * as address from "./address";
import { type Job, type Labels, type Report, isHierarchical, json, labels, nameOf, output } from "./api";
import { dendrogram } from "./dendrogram";
import { announce, count, digits, make, notice } from "./dom";
import { downloads } from "./downloads";
import { edges, triangles } from "./mesh";
import { ClusterTable, type Clusters, measure } from "./table";
import { type Triangles, View } from "./view";

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
  private readonly compared = make("div", { class: "tools" });
  private readonly level = make("span", { id: "cut-energy" });
  private readonly table: ClusterTable;
  private readonly isTree: boolean;
  private view: View | null = null;
  private mesh: Triangles | null = null;
  private mine: Labels | null = null;
  private others: Labels | null = null;
  private clusters: Clusters | null = null;
  private cut: number | null = null;
  private selected: number | null = null;
  private rows: Promise<ClusterRow[]> | null = null;
  private edges: HTMLInputElement | null = null;
  private timer = 0;

  constructor(
    private readonly box: HTMLElement,
    rest: HTMLElement,
    private readonly job: Job,
  ) {
    this.isTree = isHierarchical(job.parameters.algorithm);
    if (this.isTree) this.cut = address.read().clusters ?? job.parameters.clusters ?? this.within(FIRST_CUT);
    const list = make("details", {}, make("summary", {}, "Table of clusters"));
    this.table = new ClusterTable(list);
    this.table.onSelect = (cluster) => this.select(cluster === this.selected ? null : cluster);
    box.replaceChildren(...(this.isTree ? [this.slider()] : []), this.figure, this.picked, this.compared);
    rest.replaceChildren(
      this.energies,
      list,
      ...(this.isTree ? [dendrogram(job, this.abort.signal)] : []),
      downloads(job, () => this.cut, this.abort.signal),
    );
  }

  async load(): Promise<void> {
    const { signal } = this.abort;
    // before anything is shown, which changes the address
    const { cluster, with: other } = address.read();
    const report = await json<Report>(output(this.job, "report"), { signal });
    this.showEnergies(report);
    await this.fetchLabels();
    if (!this.job.keep_mesh)
      this.figure.replaceChildren("The mesh was not kept with this job, so there is nothing to draw.");
    else if (report.input.triangles > MANY_TRIANGLES) this.figure.replaceChildren(this.later(report.input.triangles));
    else await this.draw();
    if (cluster !== null) this.select(cluster);
    await this.offerComparison(other);
  }

  close(): void {
    clearTimeout(this.timer);
    this.abort.abort();
    this.cutting.abort();
    this.view?.dispose();
  }

  /** Numbers of clusters that the hierarchy can be cut at, from its roots to its faces. */
  private within(clusters: number): number {
    const { clusters: least = 1, faces: most = 1 } = this.job.result ?? {};
    return Math.min(Math.max(Math.round(clusters), least), most);
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
    this.mesh = await triangles(path, this.abort.signal);
    const view = new View(this.figure, this.mesh);
    this.view = view;
    view.canvas.setAttribute("role", "img");
    view.canvas.setAttribute(
      "aria-label",
      "The mesh with its clusters. Arrow keys turn it, plus and minus zoom, 0 resets. The table has the same clusters.",
    );
    view.onPick = (triangle) => {
      const shown = this.shown();
      const face = triangle === null ? null : (this.mesh?.faces?.[triangle] ?? triangle);
      this.select(face === null || !shown ? null : (shown.numbers[face] ?? null));
    };
    this.figure.removeAttribute("aria-busy");
    this.box.querySelector("#overlay")?.remove();
    if (this.job.urls["remesh"]) this.picked.before(this.overlay());
    this.show();
  }

  private slider(): HTMLElement {
    const [least, most] = [this.within(1), this.within(Infinity)];
    const toPlace = (clusters: number): number =>
      most > least ? (1000 * Math.log(clusters / least)) / Math.log(most / least) : 0;
    const toClusters = (place: number): number => this.within(least * (most / least) ** (place / 1000));
    const first = this.cut ?? least;
    const range = make("input", {
      id: "level",
      type: "range",
      min: "0",
      max: "1000",
      step: "any",
      value: String(toPlace(first)),
    });
    const number = make("input", {
      id: "level-number",
      type: "number",
      min: String(least),
      max: String(most),
      value: String(first),
    });
    number.setAttribute("aria-label", "Number of clusters");
    const move = (clusters: number): void => {
      this.cut = this.within(clusters);
      address.amend({ clusters: this.cut });
      range.setAttribute("aria-valuetext", `${this.cut} clusters`);
      clearTimeout(this.timer);
      this.timer = window.setTimeout(() => void this.fetchLabels().catch((error) => this.fail(error)), REST);
    };
    range.addEventListener("input", () => {
      const clusters = toClusters(Number(range.value));
      number.value = String(clusters);
      move(clusters);
    });
    number.addEventListener("change", () => {
      const clusters = this.within(Number(number.value) || least);
      number.value = String(clusters);
      range.value = String(toPlace(clusters));
      move(clusters);
    });
    return make(
      "div",
      { class: "tools level" },
      make("label", { for: "level" }, "Clusters"),
      range,
      number,
      this.level,
    );
  }

  /** Fetches the labels at the cut; an answer that comes after a later move is dropped. */
  private async fetchLabels(): Promise<void> {
    this.cutting.abort();
    const cutting = new AbortController();
    this.cutting = cutting;
    try {
      this.mine = await labels(this.job, this.cut, cutting.signal);
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
    this.level.textContent = this.mine?.energy ? `energy ${digits(this.mine.energy)}` : "";
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
    if (!clusters || selected === null) return "No cluster is selected. Click on one, or take one from the table.";
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

  private async showRemesh(isOn: boolean): Promise<void> {
    if (!isOn) return this.view?.setLines(null);
    const path = output(this.job, "remesh", { format: "glb", clusters: this.cut });
    const { segments, centre } = await edges(path, this.abort.signal);
    this.view?.setLines(segments, centre);
    this.figure.dataset["edges"] = String(segments.length / 6);
  }

  private showEnergies(report: Report): void {
    const { initial, final, hexagon_ratio: ratio } = report.energy;
    const rows: [string, string][] = [["faces", count(report.input.faces)]];
    // of a whole hierarchy they are those of its roots
    const isFlat = !this.isTree || this.job.parameters.clusters;
    if (initial !== null && initial !== undefined) rows.push(["energy at the start", digits(initial)]);
    if (isFlat && final !== null && final !== undefined) rows.push(["energy at the end", digits(final)]);
    if (isFlat && ratio !== null && ratio !== undefined) rows.push(["of a tiling with hexagons", ratio.toFixed(4)]);
    rows.push(["clustered in", `${digits(report.timings_ms["cluster"] ?? 0)} ms`]);
    this.energies.replaceChildren(
      ...rows.map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value))),
    );
    for (const warning of report.warnings) this.energies.after(make("p", { class: "warning" }, warning));
  }

  /** Other jobs of equally many faces from a file of the same name. */
  private async offerComparison(chosen: string | null): Promise<void> {
    const { signal } = this.abort;
    const { jobs } = await json<{ jobs: Job[] }>("/v1/jobs?state=succeeded&limit=200", { signal });
    const faces = this.job.result?.faces;
    const same = jobs.filter(
      (job) => job.id !== this.job.id && job.result?.faces === faces && nameOf(job) === nameOf(this.job),
    );
    if (same.length === 0) return;
    const choice = make("select", { id: "other" }, make("option", { value: "" }, "no other job"));
    for (const { id, parameters: p } of same) {
      choice.append(
        make(
          "option",
          { value: id },
          `${p.algorithm}, ${p.clusters ?? "all"}, ${p.quality ?? "default"} (${id.slice(0, 8)})`,
        ),
      );
    }
    const told = make("span", { id: "compared" });
    const compare = async (): Promise<void> => {
      const other = same.find((job) => job.id === choice.value) ?? null;
      address.amend({ with: other?.id ?? null });
      this.others = null;
      told.textContent = "";
      if (other) {
        const isTree = isHierarchical(other.parameters.algorithm);
        const cut = isTree ? (this.cut ?? this.job.result?.clusters ?? null) : null;
        const [shown, report] = await Promise.all([
          labels(other, cut, signal),
          json<Report>(output(other, "report"), { signal }),
        ]);
        this.others = shown;
        if (report.energy.final) told.textContent = `its energy: ${digits(report.energy.final)}`;
      }
      this.show();
    };
    choice.addEventListener("change", () => void compare().catch((error) => this.fail(error)));
    this.compared.replaceChildren(make("label", { for: "other" }, "Show the labels of"), choice, told);
    if (chosen !== null) {
      choice.value = chosen;
      await compare();
    }
  }

  private fail(error: unknown): void {
    if (!this.abort.signal.aborted) notice(error instanceof Error ? error.message : String(error));
  }
}
