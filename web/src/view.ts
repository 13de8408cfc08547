// The mesh in 3D, coloured by cluster: once, or twice with other labels under one camera, beside each other or parted by
// a line. Two passes: what is seen (seen.ts), then its colours (paint.ts). The first is drawn when the camera moves, the
// second also when labels or colours change.

import { BufferAttribute, BufferGeometry, Vector2, Vector3, type WebGLRenderer } from "three";

import type { Place, Shown, Triangles } from "./drawable";
import { type Up, groundOf, guessUp } from "./ground";
import { Paint, themeOf } from "./paint";
import { type Parting, type Rectangle, isIn, place } from "./panes";
import { Pace } from "./pace";
import { listen } from "./pointer";
import { fill, makeRenderer } from "./renderer";
import { Rig } from "./rig";
import { Seen } from "./seen";

/** Time after a move or a change of labels when the picture rests, in milliseconds. */
const REST = 200;

export class View {
  /** Called with what is under a click, and whether Shift was held. */
  onPick: (place: Place, withShift: boolean) => void = () => {};
  /** Called with what is under the pointer, and with null when it leaves. */
  onHover: (place: Place | null) => void = () => {};
  /** Called once with the canvas, as it is drawn when nothing finer follows. */
  onSettled: ((canvas: HTMLCanvasElement) => void) | null = null;
  /** Frames drawn. */
  frames = 0;
  readonly canvas: HTMLCanvasElement;
  readonly rig: Rig;
  readonly guessedUp: Up;
  readonly items: number;

  private readonly renderer: WebGLRenderer;
  private readonly geometry: BufferGeometry;
  private readonly radius: number;
  private readonly seen: Seen;
  private readonly paints: Paint[];
  private readonly observer: ResizeObserver;
  private readonly scheme = matchMedia("(prefers-color-scheme: dark)");
  private readonly redraw = (): void => {
    this.theme = themeOf(this.box);
    this.draw();
  };
  private up: Up | null = null;
  private theme: ReturnType<typeof themeOf>;
  private parting: Parting = "beside";
  private isAbove = false;
  private coarse: Uint32Array | null = null;
  private pending = 0;
  private resting = 0;
  private turning = 0;
  private then = 0;
  /** Samples along a pixel of what is seen; 0 where that is to be drawn anew. */
  private finer = 0;
  /** That of the last frame, and all that its pixels around the mesh depend on. */
  private quality = "";
  private around = "";
  private readonly pace: Pace;
  /** Pixels of the canvas along one of the box, where it is not shrunk. */
  private readonly ratio = Math.min(devicePixelRatio, 2);

  constructor(
    private readonly box: HTMLElement,
    private readonly mesh: Triangles,
    format = "glb",
    up: Up | null = null,
  ) {
    this.items = mesh.positions.length / 9;
    this.renderer = makeRenderer(this.ratio);
    this.canvas = this.renderer.domElement;
    this.geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(mesh.positions, 3));
    this.geometry.computeBoundingSphere();
    this.radius = this.geometry.boundingSphere?.radius ?? 0;
    this.pace = new Pace(this.items, this.ratio);
    this.seen = new Seen(this.renderer, this.geometry);
    this.paints = [new Paint(mesh, this.radius)];
    this.guessedUp = guessUp(mesh.positions, format);
    this.theme = themeOf(box);
    this.rig = new Rig(this.canvas);
    this.rig.onMove = () => this.move();
    box.replaceChildren(this.canvas);
    this.resize();
    this.setUp(up ?? this.guessedUp);
    listen(this.canvas, {
      click: (x, y, withShift) => this.onPick(this.at(x, y), withShift),
      hover: (x, y) => this.pace.isMoving || this.onHover(this.at(x, y)),
      leave: () => this.onHover(null),
    });
    this.scheme.addEventListener("change", this.redraw);
    this.observer = new ResizeObserver(() => {
      // also called once at the beginning
      const { x, y } = this.renderer.getSize(new Vector2());
      if (x !== box.clientWidth || y !== box.clientHeight) this.resize();
    });
    this.observer.observe(box);
  }

  setUp(up: Up): void {
    this.canvas.dataset["up"] = up;
    if (up !== this.up) this.seen.setGround(groundOf(this.mesh.positions, up));
    this.up = up;
    this.seen.object.rotation.x = up === "z" ? -Math.PI / 2 : 0;
    this.seen.object.updateMatrixWorld();
    this.rig.fit(this.geometry, this.seen.object.matrixWorld, true);
    this.finer = 0;
    this.draw();
  }

  /** Colours the mesh by labels, and shows it a second time in others where there are any. */
  show(shown: Shown, others: Shown | null = null, parting: Parting = "beside"): void {
    const before = this.canvas.dataset["panes"] ?? "1";
    if (others && !this.paints[1]) this.paints.push(new Paint(this.mesh, this.radius));
    else if (!others) this.paints.splice(1).forEach((paint) => paint.dispose());
    this.paints[0]?.set(shown.labels, shown.colours);
    if (others) this.paints[1]?.set(others.labels, others.colours);
    this.parting = parting;
    const panes = `${this.paints.length}${parting === "beside" ? "" : " parted"}`;
    this.canvas.dataset["panes"] = panes;
    this.rest();
    if (before === panes) return this.draw();
    this.resize();
    this.rig.fit(this.geometry, this.seen.object.matrixWorld, false);
  }

  /** Moves the line between the two. */
  part(parting: number): void {
    this.parting = parting;
    this.rest();
    this.draw();
  }

  /** Selects a cluster of each pane's labels, or none. */
  select(cluster: number | null, other: number | null = null): void {
    if ([this.paints[0]?.select(cluster), this.paints[1]?.select(other)].includes(true)) this.draw();
  }

  hover(cluster: number | null, other: number | null = null): void {
    if ([this.paints[0]?.hover(cluster), this.paints[1]?.hover(other)].includes(true)) this.draw();
  }

  /** Draws edges over the mesh; none for null. */
  setEdges(segments: Float32Array | null, centre = new Vector3()): void {
    this.seen.setEdges(segments, centre.clone().sub(this.mesh.centre), this.rig);
    this.finer = 0;
    this.draw();
  }

  /** Turns the mesh slowly until someone moves it. */
  turn(): void {
    this.rig.isTurning = true;
    this.then = performance.now();
    this.draw();
  }

  /** Stops that: the camera rests in the next frame, however soon it is drawn. */
  hold(): void {
    if (this.pace.isCoarse) this.finer = 0;
    this.rig.isTurning = this.pace.isMoving = false;
  }

  /** Turns the mesh to where a normal of it is seen. */
  face(normal: ArrayLike<number>): void {
    this.rig.face(new Vector3().fromArray(normal).transformDirection(this.seen.object.matrixWorld));
  }

  /** What is in the canvas, as PNG. */
  async picture(): Promise<Blob> {
    if (this.pace.isCoarse) this.finer = 0;
    [this.pace.isMoving, this.pace.isResting] = [false, true];
    this.drawNow();
    return await new Promise((resolve, reject) =>
      this.canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("the picture could not be made")))),
    );
  }

  dispose(): void {
    cancelAnimationFrame(this.pending);
    clearTimeout(this.resting);
    clearTimeout(this.turning);
    this.observer.disconnect();
    this.scheme.removeEventListener("change", this.redraw);
    this.rig.dispose();
    for (const paint of this.paints) paint.dispose();
    this.seen.dispose();
    this.geometry.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.canvas.remove();
  }

  /** Draws before the next frame of the browser, once for any number of changes. */
  private draw(): void {
    this.pending ||= requestAnimationFrame((now) => {
      this.pending = 0;
      const isTurning = this.rig.isTurning;
      if (isTurning) this.rig.step(Math.min(0.1, (now - this.then) / 1000));
      this.then = now;
      this.drawNow();
      // a software renderer has other work, too
      if (isTurning) this.turning = window.setTimeout(() => this.draw(), 2 * (this.pace.moved ?? 0));
    });
  }

  private drawNow(): void {
    const { pace } = this;
    const isTimed = pace.isTimed && this.frames > 0;
    const began = performance.now();
    const { isCoarse, finer, shrink, samples } = pace;
    this.quality = pace.quality;
    if (isCoarse) this.coarse ??= this.seen.coarsen(this.mesh.positions);
    const ratio = this.ratio / shrink;
    if (this.renderer.getPixelRatio() !== ratio) this.renderer.setPixelRatio(ratio);
    this.canvas.style.imageRendering = shrink > 1 ? "pixelated" : "";
    const around = [pace.quality, this.paints.length, this.parting, this.theme.background.getHex()].join();
    const isKept = !pace.isMoving && this.finer === finer && this.around === around;
    if (pace.isMoving || this.finer !== finer) {
      const { width, height } = this.place(0, this.ratio);
      this.seen.draw(this.rig.camera, finer * width, finer * height, isCoarse);
    }
    [this.finer, this.around] = [finer, around];
    const along = finer * shrink;
    const radius = this.rig.scale * this.radius * this.place(0).height;
    const frame = { seen: this.seen.texture, finer: along, samples, outline: 2 * along * ratio, radius, ...this.theme };
    if (!isKept) fill(this.renderer, this.theme.background);
    const [left, bottom, right, top] = isKept ? this.rig.extent : [0, 0, 1, 1];
    for (const [i, paint] of this.paints.entries()) {
      const pane = this.place(i);
      const [x, y, w, h] = [pane.x / ratio, pane.y / ratio, pane.width / ratio, pane.height / ratio];
      const from = Math.max(pane.cut / ratio, left * w);
      this.renderer.setViewport(x, y, w, h);
      this.renderer.setScissor(x + from, y + bottom * h, Math.max(0, right * w - from), (top - bottom) * h);
      paint.draw(this.renderer, frame, pane.x, pane.y, along * pane.width, along * pane.height);
    }
    if (isTimed) pace.time(this.renderer.getContext(), began);
    // the first frame is drawn as one of a move, and is none
    if (this.frames++ === 0) pace.isMoving = false;
    const drawn = isCoarse ? (this.coarse?.length ?? 0) : this.items;
    const settled = pace.isResting || this.rig.isTurning;
    Object.assign(this.canvas.dataset, { frames: this.frames, drawn, settled });
    if (!pace.isResting) return;
    this.onSettled?.(this.canvas);
    this.onSettled = null;
  }

  /** Draws after a move of the camera, and again when it rests. */
  private move(): void {
    this.pace.isMoving = true;
    this.rest();
    this.draw();
  }

  /** Draws at full quality when nothing has changed for a while. */
  private rest(): void {
    const { pace } = this;
    pace.isResting = false;
    this.canvas.dataset["settled"] = "false";
    clearTimeout(this.resting);
    this.resting = window.setTimeout(() => {
      if (this.rig.isTurning) return;
      const wasMoving = pace.isMoving;
      [pace.isMoving, pace.isResting] = [false, true];
      const isFine = pace.quality === this.quality;
      if (wasMoving && !isFine) this.finer = 0;
      if (isFine && !this.onSettled) this.canvas.dataset["settled"] = "true";
      else this.draw();
    }, REST);
  }

  private place(pane: number, ratio = this.renderer.getPixelRatio()): Rectangle {
    const size = this.renderer.getSize(new Vector2()).multiplyScalar(ratio).floor();
    return place(pane, this.paints.length, this.parting, size, this.isAbove);
  }

  private resize(): void {
    const [width, height] = [this.box.clientWidth, this.box.clientHeight];
    if (width === 0 || height === 0) return;
    this.renderer.setSize(width, height);
    const style = getComputedStyle(this.box);
    this.isAbove = style.getPropertyValue("--above") === "1";
    const [top = 0, bottom = 0] = style.getPropertyValue("--covered").split(" ").map(Number);
    const pane = this.place(0, 1);
    this.rig.setSize(pane.width, pane.height, { top, bottom });
    this.finer = 0;
    this.draw();
  }

  /** Finds the pane and the triangle at a place of the canvas. */
  private at(x: number, y: number): Place {
    const ratio = this.renderer.getPixelRatio();
    const [right, up] = [ratio * x, ratio * (this.box.clientHeight - y)];
    // the second one may cover a part of the first
    const pane = this.paints.findLastIndex((_, i) => isIn(this.place(i), right, up));
    if (pane < 0) return { triangle: null, pane: 0, x, y };
    const { x: left, y: bottom } = this.place(pane);
    const along = this.finer * (this.ratio / ratio);
    const triangle = this.seen.at(Math.floor(along * (right - left)), Math.floor(along * (up - bottom)));
    return { triangle, pane, x, y };
  }
}
