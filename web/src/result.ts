// What a job on a mesh gave: its picture, cuts, a cluster and its numbers, a comparison, the remesh, files.

import * as address from "./address";
import { type Job, type Labels, type Report, json, output } from "./api";
import { coloursOf } from "./colours";
import { Comparison, counterpart, overlap } from "./compare";
import { Cutting } from "./cutting";
import { announce, make, onEscape, report } from "./dom";
import { downloads, mainDownload } from "./downloads";
import { Facts, compactness } from "./facts";
import type { Scene } from "./load";
import { Picture } from "./picture";
import type { Places } from "./places";
import { Selection, factsOf } from "./selection";
import { factsOfShape } from "./shapes";
import { type ClusterRow, type Coloured, Cuts, Rows } from "./shown";
import { ClusterTable } from "./table";
import { take } from "./take";
import { Tools } from "./tools";
import { Walk, type Where } from "./walk";
import { brief } from "./words";

/** Triangles above which 3D waits for a click: 36 bytes each on the graphics processor, and twice that here. */
const MANY_TRIANGLES = 5_000_000;

export class Result {
  private readonly abort = new AbortController();
  private readonly up = make("button", { type: "button", id: "up" }, "Merge");
  private readonly down = make("button", { type: "button", id: "down" }, "Split");
  private readonly only = make("button", { type: "button", id: "only" }, "Download this one");
  private readonly comparison: Comparison;
  private readonly table: ClusterTable;
  private readonly cutting: Cutting;
  private readonly walk: Walk;
  private readonly tools: Tools;
  private readonly selection: Selection;
  private readonly picture: Picture;
  private readonly cuts: Cuts;
  private facts: Facts | null = null;
  private report: Report | null = null;
  private energy: number | null = null;
  private selected: number | null = null;
  /** The selected cluster of the job that is beside this one. */
  private beside: number | null = null;
  private readonly rows: Rows;
  private readonly fail = (error: unknown): void => void (this.abort.signal.aborted || report(error));

  constructor(
    private readonly places: Places,
    private readonly job: Job,
    scene: Scene,
    /** Clusters as they were shown while the job ran, whose hues go on. */
    running: Coloured | null,
  ) {
    const { signal } = this.abort;
    this.cuts = new Cuts(job, signal);
    this.rows = new Rows(job, signal);
    const move = (clusters: number): void => {
      const labels = this.comparison.labels ? null : this.cuts.now(clusters);
      if (labels) this.try(this.take(labels));
    };
    const rest = (): void => this.try(this.fetchLabels());
    this.cutting = new Cutting(job, job.result?.faces ?? 1, move, rest);
    const { level } = this.cutting;
    this.comparison = new Comparison(job);
    this.comparison.onChoose = () => this.try(this.fetchLabels());
    this.comparison.onArrange = () => this.arrange();
    const where = (): Where => ({ cut: this.cutting.at, selected: this.selected });
    this.walk = new Walk(job, where, (clusters, labels) => this.cutAt(clusters, labels), this.fail, signal);
    this.selection = new Selection([...(level ? [this.up, this.down] : []), this.only]);
    this.tools = new Tools(job);
    this.picture = new Picture(job, scene, this.tools, this.selection, this.rows, running, signal);
    const list = make("details", {}, make("summary", {}, "Table of clusters"));
    this.table = new ClusterTable(list, (cluster) => this.picture.mine.css(cluster), ["faces", "area"]);
    this.listen();
    const dock = make("div", { id: "dock" }, ...(level ? [level.element] : []), this.tools.legend);
    const over = [this.comparison.captions, this.tools.element, dock, this.selection.card];
    places.stage.replaceChildren(this.picture.element, ...over);
    const cut = (): number | null => this.cutting.at;
    const glb = job.keep_mesh ? [mainDownload(job, cut, signal)] : [];
    places.inspector.replaceChildren(...glb, this.selection.element);
    const tree = level ? [this.walk.tree.element] : [];
    places.rest.replaceChildren(this.comparison.element, downloads(job, cut, signal), take(job, cut), list, ...tree);
  }

  async load(): Promise<void> {
    const { signal } = this.abort;
    // from the first labels on, so that the address keeps it
    const { cluster } = address.read();
    this.selected = cluster;
    this.report = await json<Report>(output(this.job, "report"), { signal });
    this.facts = new Facts(this.job, this.report);
    this.places.inspector.prepend(this.facts.element);
    this.picture.shapes = this.report.shapes ?? [];
    this.tools.setShapes(this.picture.shapes);
    const { triangles } = this.report.input;
    // on its way while everything else is fetched
    const mesh = this.job.keep_mesh && triangles <= MANY_TRIANGLES ? this.picture.fetch(this.cutting.at) : null;
    mesh?.catch(() => {});
    await this.comparison.offer(signal);
    await this.fetchLabels();
    if (mesh) await this.draw(mesh);
    else if (this.job.keep_mesh)
      this.picture.offer(triangles, () => this.try(this.draw(this.picture.fetch(this.cutting.at))));
    else this.picture.element.textContent = "The mesh was not kept with this job, so there is nothing to draw.";
    if (cluster !== null && cluster === this.selected) this.picture.face(cluster);
    await this.cuts.load();
  }

  close(): void {
    this.abort.abort();
    this.cutting.close();
    this.picture.close();
  }

  private listen(): void {
    this.up.onclick = () => this.try(this.walk.step(true));
    this.down.onclick = () => this.try(this.walk.step(false));
    this.only.onclick = () => this.picture.saveOne(this.selected);
    this.selection.onDownload = () => this.picture.saveOne(this.picture.clicked);
    this.table.onSelect = (cluster) => (cluster === this.selected ? this.select(null) : this.find(cluster));
    this.tools.onColours = () => this.try(this.paint().then(() => this.tell()));
    this.tools.onOver = () => this.try(this.picture.showOver(this.cutting.at));
    this.tools.onPicture = () => this.try(this.picture.save());
    this.picture.onPick = (cluster, isOther, withShift) => this.pick(cluster, isOther, withShift);
    onEscape(() => this.select(null), this.abort.signal);
  }

  private async draw(bytes: Promise<ArrayBuffer>): Promise<void> {
    await this.picture.open(bytes);
    await this.paint();
    this.picture.keepThumbnail();
    // what follows takes a while for a large mesh, which is drawn meanwhile
    await new Promise(requestAnimationFrame);
    if (this.abort.signal.aborted) return;
    this.tell();
    if (this.tools.over) await this.picture.showOver(this.cutting.at);
  }

  /** The first click on a cluster selects it; the next one goes down the tree, or with Shift up. */
  private pick(cluster: number | null, isOther: boolean, isUp: boolean): void {
    const others = this.comparison.labels?.numbers;
    if (isOther && others)
      this.select(cluster === null ? null : counterpart(others, this.picture.mine.labels, cluster), cluster);
    else if (cluster !== null && cluster === this.selected && this.cutting.level) this.try(this.walk.step(isUp));
    else this.select(cluster);
  }

  /** Cuts the hierarchy, and selects the largest of some clusters there. */
  private async cutAt(clusters: number, labels: number[]): Promise<void> {
    this.cutting.set(clusters);
    address.amend({ clusters });
    await this.fetchLabels();
    if (this.abort.signal.aborted) return;
    const { faces } = this.picture.mine.clusters;
    const largest = labels.reduce((a, b) => ((faces[b] ?? 0) > (faces[a] ?? 0) ? b : a));
    if (this.cutting.at === clusters) this.select(largest);
  }

  /** Fetches the labels at the cut; an answer that comes after a later move is dropped. */
  private async fetchLabels(): Promise<void> {
    const labels = await this.cutting.latest(async (signal) => {
      const found = await this.cuts.at(this.cutting.at, signal);
      await this.comparison.fetch(this.cutting.at, signal);
      return found;
    });
    if (!labels) return;
    await this.take(labels);
    this.tell();
    if (this.tools.over === "remesh") await this.picture.showOver(this.cutting.at);
  }

  /** Shows labels, and no more than that. */
  private async take(labels: Labels): Promise<void> {
    this.rows.cutAt(this.cutting.at);
    this.energy = labels.energy ?? this.report?.energy.final ?? null;
    const { mine, other } = this.picture;
    const others = this.comparison.labels?.numbers;
    other.labels = others ?? new Uint32Array();
    if (others) mine.setBoth(labels.numbers, other, others);
    else mine.set(labels.numbers);
    await this.paint();
  }

  private async paint(): Promise<void> {
    const { mine, shapes } = this.picture;
    const colours = await coloursOf(mine, shapes, () => this.rows.fetch());
    if (colours === undefined) return;
    this.tools.tell(colours?.ends ?? []);
    this.picture.show(colours?.bytes ?? null, this.comparison.labels !== null, this.comparison.parting);
  }

  private arrange(): void {
    const { parting } = this.comparison;
    if (parting !== "beside" && this.comparison.isParted) this.picture.part(parting);
    else this.try(this.paint());
    this.tellComparison();
  }

  /** Everything but the picture. */
  private tell(): void {
    const { mine, other } = this.picture;
    this.picture.pointAway();
    this.facts?.tell(this.energy);
    this.places.words.textContent = brief(this.job, mine.hues.length);
    mine.measure();
    if (this.comparison.labels) other.measure();
    this.table.show([mine.clusters.faces, mine.clusters.area]);
    this.tellComparison();
    this.select(this.selected);
  }

  private tellComparison(): void {
    const part = this.cutting.level || !this.report ? null : compactness(this.report);
    this.comparison.tell({ clusters: this.picture.mine.hues.length, energy: this.energy, compactness: part });
  }

  /** Selects a cluster, and of the job beside it the given one, or that which has most of its faces. */
  private select(cluster: number | null, beside: number | null = null): void {
    const { mine } = this.picture;
    const has = cluster !== null && cluster < mine.clusters.faces.length;
    this.selected = has ? cluster : null;
    const others = this.comparison.labels?.numbers;
    this.beside = this.selected !== null && others ? (beside ?? counterpart(mine.labels, others, this.selected)) : null;
    this.picture.select(this.selected, this.beside);
    this.table.select(this.selected);
    address.amend({ cluster: this.selected });
    this.up.disabled = this.down.disabled = this.only.disabled = this.selected === null;
    this.tellSelected(null);
    this.walk.mark();
    if (this.selected === null) return;
    announce(`cluster ${this.selected} is selected`);
    if (this.job.urls["clusters"]) this.try(this.tellMore(this.selected));
  }

  /** Selects a cluster that may be on the other side. */
  private find(cluster: number): void {
    this.select(cluster);
    if (this.selected !== null) this.picture.face(this.selected);
  }

  /** Adds what the service's table of clusters has beyond the page's own numbers. */
  private async tellMore(cluster: number): Promise<void> {
    const row = (await this.rows.fetch())[cluster];
    if (row && this.selected === cluster) this.tellSelected(row);
  }

  /** The numbers of the selected cluster, and of the one beside it. */
  private tellSelected(row: ClusterRow | null): void {
    const { selected, beside } = this;
    if (selected === null) return this.selection.show(null, this.cutting.level !== null);
    const { mine, mesh } = this.picture;
    const shape = this.picture.shapes[selected];
    const facts = [...(shape ? factsOfShape(shape) : []), ...factsOf(selected, mine.clusters, mesh !== null, row)];
    const others = this.comparison.labels?.numbers;
    if (beside !== null && others) facts.push(["Beside", overlap(mine.labels, selected, others, beside)]);
    this.selection.show({ cluster: selected, colour: mine.css(selected), facts }, this.cutting.level !== null);
  }

  private try(work: Promise<void>): void {
    work.catch(this.fail);
  }
}
