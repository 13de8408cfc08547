// What a job on an image gave: the image with lines around its superpixels, their mean colours or hues, a superpixel
// and its numbers, the table, the files. The image itself is shown as long as this page has it.

import * as address from "./address";
import { type Job, type Report, json, labels, output, request } from "./api";
import { announce, count, digits, make, onEscape, report, save } from "./dom";
import { downloads, stem } from "./downloads";
import { Facts } from "./facts";
import type { Scene } from "./load";
import { LAYERS, type Layer } from "./layers";
import { pixelsOf } from "./photo";
import { Pixels } from "./pixels";
import type { Places } from "./places";
import type { Plane } from "./plane";
import { Selection } from "./selection";
import { ClusterTable } from "./table";
import { take } from "./take";
import { keepThumbnail } from "./thumbnails";
import { brief } from "./words";

/** Pixels above which the view waits for a click: 12 bytes each. */
const MANY_PIXELS = 50_000_000;

const NAMES: Record<Layer, string> = { photo: "Photo", means: "Means", colours: "Superpixels" };

/** What the service's table has of a superpixel. */
interface Row {
  neighbours: number;
  energy: number;
}

export class Superpixels {
  private readonly abort = new AbortController();
  private readonly view = make("div", { id: "view", class: "view" });
  private readonly selection = new Selection([]);
  private readonly table: ClusterTable;
  private readonly layers = make("div", { id: "layers", role: "group", "aria-label": "What is shown" });
  private readonly dock = make("div", { id: "dock", hidden: true });
  private readonly sample = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  private plane: Plane | null = null;
  private pixels: Pixels | null = null;
  private photo: ImageBitmap | null = null;
  private means: ImageBitmap | null = null;
  private rows: Row[] = [];
  private selected: number | null = null;

  constructor(
    private readonly places: Places,
    private readonly job: Job,
    private readonly scene: Scene,
    /** The image as it was sent, if this page has it. */
    private readonly file: File | null,
  ) {
    const { signal } = this.abort;
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
    const cut = (): null => null;
    places.rest.replaceChildren(downloads(job, cut, signal), take(job, cut), list);
  }

  async load(): Promise<void> {
    const { signal } = this.abort;
    // before anything is shown, which changes the address
    const { cluster } = address.read();
    const report = await json<Report>(output(this.job, "report"), { signal });
    this.places.inspector.prepend(new Facts(this.job, report).element);
    const [height = 0, width = 0] = report.input.shape ?? [];
    const open = (): Promise<void> => this.open(width, height, cluster);
    if (width * height <= MANY_PIXELS) return await open();
    const text = `Show ${count(width * height)} pixels`;
    this.view.replaceChildren(make("button", { type: "button", onclick: () => this.try(open()) }, text));
  }

  close(): void {
    this.abort.abort();
    this.plane?.dispose();
    this.photo?.close();
    this.means?.close();
  }

  private async open(width: number, height: number, cluster: number | null): Promise<void> {
    const { signal } = this.abort;
    this.view.setAttribute("aria-busy", "true");
    const { means, clusters } = this.job.urls;
    const [numbers, photo, mean, rows] = await Promise.all([
      labels(this.job, null, signal),
      this.file ? pixelsOf(this.file).catch(() => null) : null,
      means ? request(means, { signal }).then(async (answer) => await pixelsOf(await answer.blob())) : null,
      clusters && this.job.outputs.includes("clusters.csv") ? this.readRows(clusters) : [],
    ]);
    signal.throwIfAborted();
    this.pixels = new Pixels({ width, height }, numbers.numbers);
    this.photo = photo?.width === width && photo.height === height ? photo : null;
    [this.means, this.rows] = [mean, rows];
    if (mean) keepThumbnail(this.job.id, mean);
    const plane = new this.scene.Plane(this.view, { width, height });
    this.plane = plane;
    plane.canvas.setAttribute(
      "aria-label",
      "The image with its superpixels. Arrow keys move it, plus and minus zoom, 0 shows all. The table has the same.",
    );
    plane.onPick = (pixel) => this.select(this.clusterAt(pixel));
    plane.onHover = (pixel, x, y) => this.hover(pixel, x, y);
    this.view.removeAttribute("aria-busy");
    this.view.dataset["clusters"] = String(this.pixels.clusters);
    this.dock.hidden = false;
    this.table.show([this.pixels.items, Float64Array.from(this.rows, ({ energy }) => energy)]);
    this.paint();
    this.select(cluster);
  }

  /** Layers that there are; the photo only in the visit that sent it. */
  private has(layer: Layer): boolean {
    if (layer === "colours") return true;
    return (layer === "photo" ? this.photo : this.means) !== null;
  }

  private paint(): void {
    if (!this.plane || !this.pixels) return;
    const asked = address.read().layer;
    const layer = asked && this.has(asked) ? asked : (LAYERS.find((one) => this.has(one)) ?? "colours");
    const image = layer === "photo" ? this.photo : layer === "means" ? this.means : null;
    this.plane.show(image, this.pixels.shown, layer);
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

  /** The rows of `clusters.csv`. */
  private async readRows(path: string): Promise<Row[]> {
    const text = await (await request(`${path}?format=csv`, { signal: this.abort.signal })).text();
    const [head = "", ...lines] = text.trimEnd().split("\n");
    const names = head.split(",");
    const [neighbours, energy] = [names.indexOf("neighbours"), names.indexOf("energy")];
    return lines.map((line) => {
      const values = line.split(",");
      return { neighbours: Number(values[neighbours]), energy: Number(values[energy]) };
    });
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
    const row = this.rows[cluster];
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
    const row = this.rows[this.selected];
    const facts: [string, string][] = [["Pixels", count(pixels.items[this.selected] ?? 0)]];
    const colour = this.mean(this.selected);
    if (this.means) facts.push(["Colour", colour]);
    if (row) facts.push(["Neighbours", count(row.neighbours)], ["Energy", digits(row.energy)]);
    this.selection.show({ cluster: this.selected, colour, facts }, false, "superpixel");
    announce(`superpixel ${this.selected} is selected`);
  }

  /** The mean colour of a superpixel, else its hue. */
  private mean(cluster: number): string {
    const { means, pixels, sample } = this;
    if (!pixels) return "";
    if (!means || !sample) return pixels.hue(cluster);
    const first = pixels.first[cluster] ?? 0;
    const { width } = pixels.size;
    sample.drawImage(means, first % width, Math.floor(first / width), 1, 1, 0, 0, 1, 1);
    const [red = 0, green = 0, blue = 0] = sample.getImageData(0, 0, 1, 1).data;
    return `#${[red, green, blue].map((channel) => channel.toString(16).padStart(2, "0")).join("")}`;
  }

  private async save(): Promise<void> {
    if (this.plane) save(await this.plane.picture(), `${stem(this.job)}-${this.pixels?.clusters ?? 0}.png`);
  }

  private try(work: Promise<void>): void {
    work.catch((error: unknown) => this.abort.signal.aborted || report(error));
  }
}
