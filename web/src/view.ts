// The mesh in 3D, coloured by cluster: once, or twice beside each other with other labels under one camera.
//
// Where a frame takes long, as with a software renderer, a coarse mesh is drawn while the camera moves, and the whole
// one when it rests.

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  Group,
  LineBasicMaterial,
  LineSegments,
  PerspectiveCamera,
  Scene,
  Sphere,
  Spherical,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import { coarsen } from "./coarse";
import { meet } from "./pick";
import { Surface } from "./surface";

/** Triangles of a mesh in upload order: nine numbers each, about `centre`. */
export interface Triangles {
  positions: Float32Array;
  centre: Vector3;
  /** The face of each triangle; null where every face is a triangle. */
  faces: Uint32Array | null;
}

/** The mesh in the colours of one job's labels. */
interface Pane {
  scene: Scene;
  /** The whole mesh, and the coarse one where there is one. */
  surfaces: Surface[];
  labels: Uint32Array | null;
  selected: number | null;
}

/** Angle of a turn by a key. */
const TURN = Math.PI / 24;

/** Part of the length of an edge by which the mesh is behind it. */
const STEP_BACK = 0.2;

/** Triangles up to which edges are smoothed. A software renderer takes more than twice the time for it. */
const MOST_SMOOTHED = 500_000;

/** Triangles above which the time of a frame matters. */
const MANY = 100_000;

/** Time of a frame above which a coarse mesh is drawn while the camera moves, in milliseconds. */
const SLOW = 60;

/** Time after a move when the camera rests, in milliseconds. */
const REST = 200;

/** Pixels between two panes. */
const GAP = 2;

export class View {
  /** Called with the triangle under a click, or null, whether Shift was held, and the pane: 0, or 1 for the second. */
  onPick: (triangle: number | null, withShift: boolean, pane: number) => void = () => {};
  /** Frames drawn. */
  frames = 0;
  readonly canvas: HTMLCanvasElement;

  private readonly renderer: WebGLRenderer;
  private readonly camera = new PerspectiveCamera(35, 1, 0.01, 100);
  private readonly controls: OrbitControls;
  private readonly geometry: BufferGeometry;
  private coarse: { geometry: BufferGeometry; faces: Uint32Array } | null = null;
  private readonly panes: Pane[] = [];
  private readonly lines = new Group();
  private readonly bounds: Sphere;
  private readonly observer: ResizeObserver;
  private pending = 0;
  private resting = 0;
  private isMoving = false;
  /** Whether frames take long; null until one was measured. */
  private isSlow: boolean | null = null;

  constructor(
    private readonly box: HTMLElement,
    private readonly mesh: Triangles,
  ) {
    const isSmoothed = this.triangles <= MOST_SMOOTHED;
    this.renderer = new WebGLRenderer({ antialias: isSmoothed, powerPreference: "high-performance" });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setScissorTest(true);
    this.canvas = this.renderer.domElement;
    this.geometry = geometryOf(mesh.positions);
    this.bounds = this.geometry.boundingSphere ?? new Sphere();
    this.panes.push(this.pane());
    this.panes[0]?.scene.add(this.lines);

    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.addEventListener("change", () => this.move());
    box.replaceChildren(this.canvas);
    this.resize();
    this.fit(new Vector3(0.45, 0.5, 1));
    this.canvas.tabIndex = 0;
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    this.listenToClicks();
    this.observer = new ResizeObserver(() => {
      // also called once at the beginning
      const { x, y } = this.renderer.getSize(new Vector2());
      if (x !== box.clientWidth || y !== box.clientHeight) this.resize();
    });
    this.observer.observe(box);
  }

  get triangles(): number {
    return this.mesh.positions.length / 9;
  }

  /** Colours the mesh by labels, and shows it a second time in others where there are any. */
  setLabels(labels: Uint32Array, others: Uint32Array | null = null): void {
    if (others && this.panes.length === 1) this.panes.push(this.pane());
    else if (!others && this.panes.length === 2) this.panes.pop()?.surfaces.forEach((surface) => surface.dispose());
    else this.draw();
    for (const [i, pane] of this.panes.entries()) {
      const shown = i === 0 ? labels : others;
      if (!shown) continue;
      pane.labels = shown;
      for (const surface of pane.surfaces) surface.setLabels(shown);
    }
    if (this.canvas.dataset["panes"] === String(this.panes.length)) return;
    this.canvas.dataset["panes"] = String(this.panes.length);
    this.resize();
    this.fit(this.camera.position.clone().sub(this.controls.target));
  }

  /** Selects a cluster of each pane's labels, or none. */
  select(cluster: number | null, other: number | null = null): void {
    for (const [i, pane] of this.panes.entries()) {
      const selected = i === 0 ? cluster : other;
      if (pane.selected === selected) continue;
      pane.selected = selected;
      for (const surface of pane.surfaces) surface.select(selected);
      this.draw();
    }
  }

  /** Draws edges over the mesh; none for null. Chords of a curved surface are below it, so the mesh steps back. */
  setLines(segments: Float32Array | null, centre = new Vector3()): void {
    this.clearLines();
    const units = segments ? this.unitsBehind(segments) : 1;
    for (const surface of this.panes[0]?.surfaces ?? []) surface.stepBack(units);
    if (segments) {
      const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(segments, 3));
      this.lines.add(new LineSegments(geometry, new LineBasicMaterial({ color: 0x101010 })));
      this.lines.position.copy(centre).sub(this.mesh.centre);
    }
    this.draw();
  }

  dispose(): void {
    cancelAnimationFrame(this.pending);
    clearTimeout(this.resting);
    this.observer.disconnect();
    this.controls.dispose();
    this.clearLines();
    for (const { surfaces } of this.panes) surfaces.forEach((surface) => surface.dispose());
    this.geometry.dispose();
    this.coarse?.geometry.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.canvas.remove();
  }

  private pane(): Pane {
    const pane = { scene: new Scene(), surfaces: [], labels: null, selected: null };
    this.addSurface(pane, this.geometry, this.mesh.faces);
    if (this.coarse) this.addSurface(pane, this.coarse.geometry, this.coarse.faces);
    return pane;
  }

  private addSurface(pane: Pane, geometry: BufferGeometry, faces: Uint32Array | null): void {
    const surface = new Surface(geometry, faces);
    if (pane.labels) surface.setLabels(pane.labels);
    surface.select(pane.selected);
    pane.surfaces.push(surface);
    pane.scene.add(surface.object);
  }

  /** Draws before the next frame of the browser, once for any number of changes. */
  private draw(): void {
    this.pending ||= requestAnimationFrame(() => {
      this.pending = 0;
      const isCoarse = this.isMoving && this.isSlow === true;
      if (isCoarse) this.coarse ??= this.makeCoarse();
      const began = performance.now();
      const background = new Color(getComputedStyle(this.box).backgroundColor);
      for (const [i, { scene, surfaces }] of this.panes.entries()) {
        for (const [j, { object }] of surfaces.entries()) object.visible = j > 0 === isCoarse;
        const [x, y, width, height] = this.place(i);
        this.renderer.setViewport(x, y, width, height);
        this.renderer.setScissor(x, y, width, height);
        scene.background = background;
        this.renderer.render(scene, this.camera);
      }
      // the first frame makes shaders and buffers too
      const isToTime = this.isMoving && this.isSlow === null && this.frames > 0 && this.triangles > MANY;
      if (isToTime) this.isSlow = this.timeSince(began) > SLOW;
      this.frames++;
      const drawn = isCoarse ? (this.coarse?.faces.length ?? 0) : this.triangles;
      Object.assign(this.canvas.dataset, { frames: this.frames, drawn });
    });
  }

  /** Draws after a move of the camera, and again when it rests. */
  private move(): void {
    this.isMoving = true;
    clearTimeout(this.resting);
    this.resting = window.setTimeout(() => {
      this.isMoving = false;
      if (this.isSlow) this.draw();
    }, REST);
    this.draw();
  }

  /** Milliseconds until everything that was drawn since is there: a pixel can be read only then. */
  private timeSince(began: number): number {
    const gl = this.renderer.getContext();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    return performance.now() - began;
  }

  private makeCoarse(): { geometry: BufferGeometry; faces: Uint32Array } {
    const { positions, sources } = coarsen(this.mesh.positions);
    const { faces } = this.mesh;
    const coarse = {
      geometry: geometryOf(positions),
      faces: faces ? sources.map((triangle) => faces[triangle] ?? 0) : sources,
    };
    for (const pane of this.panes) this.addSurface(pane, coarse.geometry, coarse.faces);
    return coarse;
  }

  /** Left, bottom, width and height of a pane: two are beside each other, or on a narrow screen one above the other. */
  private place(pane: number): [number, number, number, number] {
    const [width, height] = [this.box.clientWidth, this.box.clientHeight];
    if (this.panes.length === 1) return [0, 0, width, height];
    const isWide = width >= height;
    const [w, h] = isWide ? [(width - GAP) / 2, height] : [width, (height - GAP) / 2];
    const isSecond = pane === 1;
    return isWide ? [isSecond ? w + GAP : 0, 0, w, h] : [0, isSecond ? 0 : h + GAP, w, h];
  }

  /** A part of the mean length of the edges, in units of a depth buffer of 24 bits at the distance of the mesh. */
  private unitsBehind(segments: Float32Array): number {
    let sum = 0;
    for (let i = 0; i + 5 < segments.length; i += 6) {
      const along = (axis: number): number => (segments[i + 3 + axis] ?? 0) - (segments[i + axis] ?? 0);
      sum += Math.hypot(along(0), along(1), along(2));
    }
    const depth = (STEP_BACK * sum) / (segments.length / 6 || 1);
    const distance = this.camera.position.distanceTo(this.controls.target);
    return 1 + (depth * this.camera.near * 2 ** 24) / distance ** 2;
  }

  private clearLines(): void {
    for (const line of this.lines.children as LineSegments[]) {
      line.geometry.dispose();
      (line.material as LineBasicMaterial).dispose();
    }
    this.lines.clear();
  }

  /** Puts the camera in a direction from the mesh, where the whole mesh is seen. */
  private fit(direction: Vector3): void {
    const { center, radius } = this.bounds;
    const narrow = Math.min(1, this.camera.aspect);
    const distance = (1.05 * radius || 1) / Math.sin((this.camera.fov * Math.PI) / 360) / narrow;
    this.camera.position.copy(center).addScaledVector(direction.normalize(), distance);
    this.camera.near = distance / 200;
    this.camera.far = distance * 20;
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(center);
    this.controls.update();
  }

  private resize(): void {
    const [width, height] = [this.box.clientWidth, this.box.clientHeight];
    if (width === 0 || height === 0) return;
    this.renderer.setSize(width, height);
    const [, , w, h] = this.place(0);
    this.camera.aspect = w / h;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  private key(event: KeyboardEvent): void {
    const turns: Record<string, [number, number, number]> = {
      ArrowLeft: [-TURN, 0, 1],
      ArrowRight: [TURN, 0, 1],
      ArrowUp: [0, -TURN, 1],
      ArrowDown: [0, TURN, 1],
      "+": [0, 0, 0.9],
      "=": [0, 0, 0.9],
      "-": [0, 0, 1 / 0.9],
    };
    if (event.key === "0") this.fit(new Vector3(0.45, 0.5, 1));
    const turn = turns[event.key];
    if (!turn || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const offset = this.camera.position.clone().sub(this.controls.target);
    const place = new Spherical().setFromVector3(offset);
    place.theta += turn[0];
    place.phi += turn[1];
    place.radius *= turn[2];
    this.camera.position.copy(this.controls.target).add(offset.setFromSpherical(place.makeSafe()));
    this.controls.update();
  }

  /** A click is a press and a release at one place; a drag turns the mesh. */
  private listenToClicks(): void {
    const down = new Vector2();
    this.canvas.addEventListener("pointerdown", (event) => down.set(event.offsetX, event.offsetY));
    this.canvas.addEventListener("pointerup", (event) => {
      const moved = down.distanceTo(new Vector2(event.offsetX, event.offsetY));
      if (event.button === 0 && moved < 4) this.pick(event.offsetX, event.offsetY, event.shiftKey);
    });
  }

  /** Finds the pane and the triangle at a place of the canvas. */
  private pick(x: number, y: number, withShift: boolean): void {
    const up = this.box.clientHeight - y;
    for (let pane = 0; pane < this.panes.length; pane++) {
      const [left, bottom, width, height] = this.place(pane);
      const [u, v] = [(2 * (x - left)) / width - 1, (2 * (up - bottom)) / height - 1];
      if (Math.abs(u) > 1 || Math.abs(v) > 1) continue;
      const near = new Vector3(u, v, -1).unproject(this.camera);
      const far = new Vector3(u, v, 1).unproject(this.camera);
      this.onPick(meet(this.mesh.positions, near, far.sub(near)), withShift, pane);
    }
  }
}

function geometryOf(positions: Float32Array): BufferGeometry {
  const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(positions, 3));
  geometry.computeBoundingSphere();
  return geometry;
}
