// What a job on an image gave: the image with lines around its superpixels, their mean colours or hues, cuts, a
// superpixel and its numbers, the table, the files. The image itself is shown where this page has it, or the service
// keeps it.

import * as address from "./address";
import { type Job, type Labels, type Report, json, output, request } from "./api";
import { Cutting } from "./cutting";
import { announce, count, digits, make, onEscape, report, save } from "./dom";
import { downloads, stem } from "./downloads";
import { Facts } from "./facts";
import type { Scene } from "./load";
import { LAYERS, type Layer } from "./layers";
import { dataOf, pixelsOf, type Size } from "./photo";
import { Pixels } from "./pixels";
import type { Places } from "./places";
import type { Plane } from "./plane";
import { Selection } from "./selection";
import { Cuts, Rows } from "./shown";
import { ClusterTable } from "./table";
import { take } from "./take";
import { keepThumbnail } from "./thumbnails";
import { uploaded } from "./uploaded";
import { brief } from "./words";

/** Pixels above which the view waits for a click: 12 bytes each. */
const MANY_PIXELS = 50_000_000;

const NAMES: Record<Layer, string> = { photo: "Photo", means: "Means", colours: "Superpixels" };

export class Superpixels {
  private readonly abort = new AbortController();
  private readonly view = make("div", { id: "view", class: "view" });
  private readonly selection = new Selection([]);
  private readonly table: ClusterTable;
  private readonly layers = make("div", { id: "layers", role: "group", "aria-label": "What is shown" });
  private readonly dock = make("div", { id: "dock", hidden: true });
  private plane: Plane | null = null;
  private pixels: Pixels | null = null;
  private photo: ImageBitmap | null = null;
  /** The bytes of the photo, of which means are made while the slider moves. */
  private bytes: ImageData | null = null;
  /** The mean colour of each superpixel, four bytes. */
  private means: Uint8Array | null = null;
  private readonly cuts: Cuts;
  private readonly rows: Rows;
  private cutting: Cutting | null = null;
  private facts: Facts | null = null;
  private size: Size = { width: 0, height: 0 };
  private selected: number | null = null;

  constructor(
    private readonly places: Places,
    private readonly job: Job,
    private readonly scene: Scene,
    /** The image as it was sent, if this page has it. */
    private readonly file: File | null,
  ) {
    const { signal } = this.abort;
    this.cuts = new Cuts(job, signal);
    this.rows = new Rows(job, signal);
    const fit = make("button", { type: "button", id: "fit", onclick: () => this.plane?.fit() }, "Fit");
    const picture = make("button", { type: "button", id: "picture", onclick: () => this.try(this.save()) }, "PNG");
    picture.setAttribute("aria-label", "Save a picture of this view as PNG");
    this.dock.append(make("div", { class: "level" }, this.layers, fit, picture));
    const list = make("details", {}, make("summary", {}, "Table of superpixels"));
    this.table = new ClusterTable(list, (cluster) => this.mean(cluster), ["pixels", "energy"]);
    this.table.onSelect = (cluster) => this.select(cluster === this.selected ? null : cluster);
    onEscape(() => this.select(null), signal);
    places.stage.replaceChildren(this.view, this.dock, this.selection.card);
    places.inspector.replaceChildren(this.selection.element);
    places.words.textContent = brief(job);
    const cut = (): number | null => this.cutting?.at ?? null;
    places.rest.replaceChildren(downloads(job, cut, signal), take(job, cut), list);
  }

  async load(): Promise<void> {
    const { signal } = this.abort;
    // before anything is shown, which changes the address
    this.selected = address.read().cluster;
    const report = await json<Report>(output(this.job, "report"), { signal });
    this.facts = new Facts(this.job, report);
    this.places.inspector.prepend(this.facts.element);
    const [height = 0, width = 0] = report.input.shape ?? [];
    this.size = { width, height };
    const most = width * height - (report.input.masked ?? 0);
    const move = (clusters: number): void => {
      const labels = this.cuts.now(clusters);
      if (labels) this.take(labels);
    };
    this.cutting = new Cutting(this.job, most, move, () => this.try(this.rest()));
    if (this.cutting.level) this.dock.prepend(this.cutting.level.element);
    const open = async (): Promise<void> => {
      await this.open();
      await this.rest();
      await this.cuts.load();
    };
    if (width * height <= MANY_PIXELS) return await open();
    const text = `Show ${count(width * height)} pixels`;
    this.view.replaceChildren(make("button", { type: "button", onclick: () => this.try(open()) }, text));
  }

  close(): void {
    this.abort.abort();
    this.cutting?.close();
    this.plane?.dispose();
    this.photo?.close();
  }

  private async open(): Promise<void> {
    const { signal } = this.abort;
    const { job, size, cutting } = this;
    this.view.setAttribute("aria-busy", "true");
    const kept = this.file || !job.keep_mesh ? null : await this.orNull(uploaded(job, signal), signal);
    const file = this.file ?? kept?.[0];
    const photo = file ? await pixelsOf(file).catch(() => null) : null;
    signal.throwIfAborted();
    this.photo = photo?.width === size.width && photo.height === size.height ? photo : null;
    if (this.photo && cutting?.level) this.bytes = dataOf(this.photo);
    const plane = new this.scene.Plane(this.view, size, Boolean(cutting?.level));
    this.plane = plane;
    plane.canvas.setAttribute(
      "aria-label",
      "The image with its superpixels. Arrow keys move it, plus and minus zoom, 0 shows all. The table has the same.",
    );
    plane.onPick = (pixel) => this.select(this.clusterAt(pixel));
    plane.onHover = (pixel, x, y) => this.hover(pixel, x, y);
    this.dock.hidden = false;
  }

  /** Shows the labels at the cut, then fetches what takes longer. */
  private async rest(): Promise<void> {
    const { job, cutting } = this;
    const clusters = cutting?.at ?? null;
    const { means } = job.urls;
    const found = await cutting?.latest(async (signal) => {
      const get = async (): Promise<ImageBitmap> =>
        await pixelsOf(await (await request(output(job, "means", { clusters }), { signal })).blob());
      const coming = means ? this.orNull(get(), signal) : null;
      const labels = await this.cuts.at(clusters, signal);
      // else hues would be seen for a moment
      if (!this.photo) await coming;
      this.take(labels);
      this.tell();
      const image = await coming;
      if (job.keep_mesh || job.outputs.includes("clusters.json")) await this.rows.fetch();
      return { image };
    });
    if (!found || !this.pixels) return;
    if (found.image) {
      this.means = this.pixels.firstOf(dataOf(found.image));
      keepThumbnail(job.id, found.image);
      found.image.close();
    }
    this.paint();
    this.tell();
  }

  /** Shows labels, and no more than that. */
  private take({ numbers, energy }: Labels): void {
    this.pixels = new Pixels(this.size, numbers, this.pixels);
    this.means = null;
    this.rows.cutAt(this.cutting?.at ?? null);
    if (energy !== null) this.facts?.tell(energy);
    this.view.removeAttribute("aria-busy");
    this.view.dataset["clusters"] = String(this.pixels.clusters);
    this.paint();
  }

  /** Everything but the picture. */
  private tell(): void {
    const { pixels } = this;
    if (!pixels) return;
    this.places.words.textContent = brief(this.job, pixels.clusters);
    this.selection.pointAway();
    this.table.show([pixels.items, Float64Array.from(this.rows.now ?? [], ({ energy }) => energy ?? NaN)]);
    this.select(this.selected);
  }

  /** What is not needed for hues: without it, they are shown, and the error is reported. */
  private async orNull<T>(work: Promise<T>, signal: AbortSignal): Promise<T | null> {
    try {
      return await work;
    } catch (error) {
      if (!signal.aborted) report(error);
      return null;
    }
  }

  /** Layers that there are; the photo of an image that is kept, or in the visit that sent it. */
  private has(layer: Layer): boolean {
    if (layer === "colours") return true;
    return (layer === "photo" ? this.photo : (this.means ?? this.bytes)) !== null;
  }

  private paint(): void {
    if (!this.plane || !this.pixels) return;
    const asked = address.read().layer;
    const layer = asked && this.has(asked) ? asked : (LAYERS.find((one) => this.has(one)) ?? "colours");
    const { labels, shown } = this.pixels;
    if (layer === "means") this.means ??= this.bytes && this.pixels.meansOf(this.bytes);
    const means = layer === "means" && this.means;
    this.plane.show(layer === "photo" ? this.photo : null, means ? { labels, colours: means } : shown, layer);
    this.view.dataset["layer"] = layer;
    this.layers.replaceChildren(
      ...LAYERS.filter((one) => this.has(one)).map((one) => {
        const choose = (): void => {
          address.amend({ layer: one });
          this.paint();
          this.layers.querySelector<HTMLElement>(`[data-layer=${one}]`)?.focus();
        };
        const button = make(
          "button",
          { type: "button", "aria-pressed": String(one === layer), onclick: choose },
          NAMES[one],
        );
        button.dataset["layer"] = one;
        return button;
      }),
    );
  }

  private clusterAt(pixel: number | null): number | null {
    const cluster = pixel === null ? null : (this.pixels?.labels[pixel] ?? null);
    // pixels that take no part have a label that no superpixel has
    return cluster !== null && cluster < (this.pixels?.clusters ?? 0) ? cluster : null;
  }

  private hover(pixel: number | null, x: number, y: number): void {
    const cluster = this.clusterAt(pixel);
    this.plane?.hover(cluster);
    this.view.style.cursor = cluster === null ? "" : "pointer";
    if (cluster === null) return this.selection.pointAway();
    const row = this.rows.now?.[cluster];
    const pixels = `${count(this.pixels?.items[cluster] ?? 0)} pixels`;
    const text = [pixels, this.mean(cluster), ...(row ? [`${count(row.neighbours)} neighbours`] : [])].join(" · ");
    this.selection.pointAt(x, y, this.mean(cluster), `Superpixel ${cluster}`, text);
  }

  private select(cluster: number | null): void {
    const { pixels } = this;
    if (!pixels) return;
    this.selected = cluster !== null && cluster < pixels.clusters ? cluster : null;
    this.plane?.select(this.selected);
    this.table.select(this.selected);
    address.amend({ cluster: this.selected });
    if (this.selected === null) return this.selection.show(null, false, "superpixel");
    const row = this.rows.now?.[this.selected];
    const facts: [string, string][] = [["Pixels", count(pixels.items[this.selected] ?? 0)]];
    const colour = this.mean(this.selected);
    if (this.means) facts.push(["Colour", colour]);
    if (row) facts.push(["Neighbours", count(row.neighbours)], ["Energy", digits(row.energy ?? NaN)]);
    this.selection.show({ cluster: this.selected, colour, facts }, false, "superpixel");
    announce(`superpixel ${this.selected} is selected`);
  }

  /** The mean colour of a superpixel, else its hue. */
  private mean(cluster: number): string {
    const { means, pixels } = this;
    if (!means) return pixels?.hue(cluster) ?? "";
    const colour = Array.from(means.subarray(4 * cluster, 4 * cluster + 3), (byte) =>
      byte.toString(16).padStart(2, "0"),
    );
    return `#${colour.join("")}`;
  }

  private async save(): Promise<void> {
    if (this.plane) save(await this.plane.picture(), `${stem(this.job)}-${this.pixels?.clusters ?? 0}.png`);
  }

  private try(work: Promise<void>): void {
    work.catch((error: unknown) => this.abort.signal.aborted || report(error));
  }
}
