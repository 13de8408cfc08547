// An image in a canvas: it fits at first, the wheel and two fingers zoom, a drag moves it, keys do both.

import { NO_CLUSTER } from "./palette";
import type { Shown } from "./drawable";
import type { Layer } from "./layers";
import { Overlay, type Place } from "./overlay";
import type { Size } from "./photo";
import { listen } from "./pointer";

/** Pixels of the page along one of the image, at most. */
const MOST_SCALE = 48;

/** Room around the image that fits, in pixels of the page: above, at the sides, below, there for a slider, too. */
const [ABOVE, BESIDE, BELOW, SLIDER] = [74, 24, 76, 64];
/** At the sides of a canvas that is not wider than this. */
const [NARROW, BESIDE_NARROW] = [600, 10];

/** Part of a cover over all superpixels but the selected one, of 255. */
const FADED = 184;

export class Plane {
  /** Called with the pixel under a click, and with null beside the image. */
  onPick: (pixel: number | null) => void = () => {};
  /** Called with the pixel under the pointer, and with the place of the canvas. */
  onHover: (pixel: number | null, x: number, y: number) => void = () => {};
  readonly canvas = document.createElement("canvas");
  private readonly overlay = new Overlay();
  private readonly ratio = Math.min(devicePixelRatio, 2);
  private readonly observer = new ResizeObserver(() => this.resize());
  private readonly scheme = matchMedia("(prefers-color-scheme: dark)");
  private readonly redraw = (): void => this.draw();
  /** Pointers that are down. */
  private readonly pointers = new Map<number, [number, number]>();
  private place: Place = { scale: 1, x: 0, y: 0 };
  private isFitted = true;
  private image: ImageBitmap | null = null;
  private shown: Shown | null = null;
  private layer: Layer = "photo";
  private pending = 0;
  private frames = 0;

  constructor(
    private readonly box: HTMLElement,
    private readonly size: Size,
    private readonly hasSlider = false,
  ) {
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    box.replaceChildren(this.canvas);
    this.resize();
    this.listen();
    this.observer.observe(box);
  }

  /** Shows an image, and over it labels where there are any. */
  show(image: ImageBitmap | null, shown: Shown | null, layer: Layer): void {
    [this.image, this.shown, this.layer] = [image, shown, layer];
    this.draw();
  }

  select(cluster: number | null): void {
    this.overlay.selected = cluster;
    this.draw();
  }

  hover(cluster: number | null): void {
    if (this.overlay.hovered === cluster) return;
    this.overlay.hovered = cluster;
    this.draw();
  }

  /** Shows the whole image. */
  fit(): void {
    const { ratio, canvas, size } = this;
    const beside = canvas.width / ratio <= NARROW ? BESIDE_NARROW : BESIDE;
    const below = this.hasSlider ? BELOW + SLIDER : BELOW;
    const [width, height] = [canvas.width - 2 * ratio * beside, canvas.height - ratio * (ABOVE + below)];
    const scale = Math.min(Math.max(1, width) / size.width, Math.max(1, height) / size.height, ratio * MOST_SCALE);
    const x = (canvas.width - scale * size.width) / 2;
    const y = ratio * ABOVE + (height - scale * size.height) / 2;
    this.isFitted = true;
    this.set({ scale, x, y });
  }

  /** What is in the canvas, as PNG. */
  async picture(): Promise<Blob> {
    this.drawNow();
    return await new Promise((resolve, reject) =>
      this.canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("the picture could not be made")))),
    );
  }

  dispose(): void {
    cancelAnimationFrame(this.pending);
    this.observer.disconnect();
    this.scheme.removeEventListener("change", this.redraw);
    this.canvas.remove();
  }

  private listen(): void {
    const { canvas, pointers } = this;
    listen(canvas, {
      click: (x, y) => this.onPick(this.at(x, y)),
      hover: (x, y) => this.onHover(this.at(x, y), x, y),
      leave: () => this.onHover(null, 0, 0),
    });
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        const step = event.deltaMode === WheelEvent.DOM_DELTA_PIXEL ? event.deltaY : 16 * event.deltaY;
        this.zoom(Math.exp((event.ctrlKey ? -0.01 : -0.0016) * step), event.offsetX, event.offsetY);
      },
      { passive: false },
    );
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    });
    for (const end of ["pointerup", "pointercancel"] as const)
      canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const [x, y] = [event.offsetX, event.offsetY];
      const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
      pointers.set(event.pointerId, [x, y]);
      if (!other) return this.move(x - before[0], y - before[1]);
      const apart = (from: readonly [number, number]): number => Math.hypot(from[0] - other[0], from[1] - other[1]);
      this.move((x - before[0]) / 2, (y - before[1]) / 2);
      this.zoom(apart([x, y]) / Math.max(1, apart(before)), (x + other[0]) / 2, (y + other[1]) / 2);
    });
    canvas.addEventListener("keydown", (event) => this.key(event));
    this.scheme.addEventListener("change", this.redraw);
  }

  private key(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const [x, y] = [this.box.clientWidth / 2, this.box.clientHeight / 2];
    const keys: Record<string, () => void> = {
      ArrowLeft: () => this.move(x / 4, 0),
      ArrowRight: () => this.move(-x / 4, 0),
      ArrowUp: () => this.move(0, y / 4),
      ArrowDown: () => this.move(0, -y / 4),
      "+": () => this.zoom(1.25, x, y),
      "=": () => this.zoom(1.25, x, y),
      "-": () => this.zoom(0.8, x, y),
      "0": () => this.fit(),
    };
    const act = keys[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  /** Zooms around a place of the page. */
  private zoom(by: number, x: number, y: number): void {
    const { ratio, place, size, canvas } = this;
    const least = Math.min(canvas.width / size.width, canvas.height / size.height, 1) / 4;
    const scale = Math.min(Math.max(place.scale * by, least), ratio * MOST_SCALE);
    const [real, left, top] = [scale / place.scale, ratio * x, ratio * y];
    this.isFitted = false;
    this.set({ scale, x: left + real * (place.x - left), y: top + real * (place.y - top) });
  }

  private move(x: number, y: number): void {
    if (x === 0 && y === 0) return;
    this.isFitted = false;
    this.set({ ...this.place, x: this.place.x + this.ratio * x, y: this.place.y + this.ratio * y });
  }

  /** Places the image, some of which stays in sight. */
  private set({ scale, x, y }: Place): void {
    const within = (at: number, length: number, room: number): number =>
      Math.min(Math.max(at, room / 4 - length), (3 * room) / 4);
    const { canvas, size } = this;
    this.place = {
      scale,
      x: within(x, scale * size.width, canvas.width),
      y: within(y, scale * size.height, canvas.height),
    };
    canvas.dataset["scale"] = String(scale / this.ratio);
    this.draw();
  }

  /** The pixel of the image at a place of the page. */
  private at(x: number, y: number): number | null {
    const { ratio, place, size } = this;
    const [column, row] = [(ratio * x - place.x) / place.scale, (ratio * y - place.y) / place.scale].map(Math.floor);
    if (column === undefined || row === undefined) return null;
    if (column < 0 || row < 0 || column >= size.width || row >= size.height) return null;
    return row * size.width + column;
  }

  private resize(): void {
    const { box, canvas, ratio } = this;
    const [width, height] = [box.clientWidth, box.clientHeight];
    const isSame = canvas.width === Math.round(ratio * width) && canvas.height === Math.round(ratio * height);
    if (width === 0 || height === 0 || isSame) return;
    [canvas.width, canvas.height] = [Math.round(ratio * width), Math.round(ratio * height)];
    canvas.style.width = `${width}px`;
    canvas.style.height = `${height}px`;
    if (this.isFitted) this.fit();
    else this.set(this.place);
    // a canvas that changed its size is empty
    this.drawNow();
  }

  /** Draws before the next frame of the browser, once for any number of changes. */
  private draw(): void {
    this.pending ||= requestAnimationFrame(() => this.drawNow());
  }

  private drawNow(): void {
    cancelAnimationFrame(this.pending);
    this.pending = 0;
    const context = this.canvas.getContext("2d");
    if (!context) return;
    const { place, size, image, shown, layer } = this;
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    // pixels that are enlarged are squares
    context.imageSmoothingEnabled = place.scale < 2;
    context.imageSmoothingQuality = "medium";
    if (image) context.drawImage(image, place.x, place.y, place.scale * size.width, place.scale * size.height);
    if (shown) this.overlay.draw(context, size, place, shown, layer, this.faded());
    this.canvas.dataset["frames"] = String(++this.frames);
  }

  /** The background of the view as what covers superpixels, in the order of bytes of a canvas. */
  private faded(): number {
    const [red = 0, green = 0, blue = 0] =
      getComputedStyle(this.box).borderLeftColor.match(/\d+/g)?.map(Number) ?? NO_CLUSTER;
    return ((FADED << 24) | (blue << 16) | (green << 8) | red) >>> 0;
  }
}
