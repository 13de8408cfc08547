// The camera around the mesh: by pointer, by keys, and turning by itself.

import { Box3, type BufferGeometry, type Matrix4, PerspectiveCamera, Sphere, Spherical, Vector3 } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

/** Angle of a turn by a key. */
const TURN = Math.PI / 24;

/** Turns a minute, of a mesh that turns by itself. */
const TURNS = 1.2;

/** Cosine of the angle between a normal and the camera up to which a cluster is seen well. */
const SEEN = 0.4;

/** From where a mesh is seen at first. A flat one is seen from further above, by up to `RAISED`. */
const FIRST = new Vector3(0.5, 0.34, 1);
const RAISED = 0.6;

/** What is in sight beside the mesh, in parts of it. */
const MARGIN = 1.04;

/** Most corners that the camera is put around. */
const MOST_CORNERS = 30_000;

/** Pixels of the view that other things cover, at its upper and its lower end. */
export interface Covered {
  top: number;
  bottom: number;
}

/** What the camera is put around: corners, 3 numbers each, and the sphere that has them. */
interface Extent {
  places: Float32Array;
  bounds: Sphere;
}

/** The extent of a mesh in the place where a matrix puts it. */
function extentOf(geometry: BufferGeometry, matrix: Matrix4): Extent {
  const positions = geometry.getAttribute("position").array;
  const pace = 3 * Math.ceil(positions.length / 3 / MOST_CORNERS);
  const places = new Float32Array(pace === 0 ? 0 : 3 * Math.ceil(positions.length / pace));
  const place = new Vector3();
  for (let i = 0; i < places.length; i += 3)
    place
      .fromArray(positions, (i / 3) * pace)
      .applyMatrix4(matrix)
      .toArray(places, i);
  return { places, bounds: (geometry.boundingSphere ?? new Sphere()).clone().applyMatrix4(matrix) };
}

export class Rig {
  /** Called after every move. */
  onMove: () => void = () => {};
  /** Radius of what is in sight at first, in radii of the mesh; where it is null, the mesh as it is seen from there. */
  room: number | null = null;
  readonly camera = new PerspectiveCamera(30, 1, 0.01, 100);
  private readonly controls: OrbitControls;
  private extents: Extent | null = null;
  /** Parts of the height and of the width, from the middle of what is not covered to its ends. */
  private free = { high: 1, wide: 1 };

  constructor(canvas: HTMLCanvasElement) {
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.autoRotateSpeed = TURNS;
    this.controls.addEventListener("change", () => this.onMove());
    this.controls.addEventListener("start", () => (this.controls.autoRotate = false));
    canvas.tabIndex = 0;
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  get distance(): number {
    return this.camera.position.distanceTo(this.controls.target);
  }

  /** The part of the height of the picture that a unit of length takes in the middle. */
  get scale(): number {
    return (this.camera.projectionMatrix.elements[5] ?? 1) / (2 * this.distance);
  }

  /** The part of the picture that the mesh is in, at most: its left, lower, right and upper ends, of 0 to 1. */
  get extent(): [number, number, number, number] {
    const { camera } = this;
    if (!this.extents) return [0, 0, 1, 1];
    const { bounds } = this.extents;
    const { x, y, z } = bounds.center.clone().applyMatrix4(camera.matrixWorldInverse);
    const along = (across: number, scale: number, shift: number): [number, number] => {
      const [middle, half] = [Math.atan2(across, -z), Math.asin((1.02 * bounds.radius) / Math.hypot(across, z))];
      // not a number where the camera is in the sphere
      if (!(Math.abs(middle) + half < Math.PI / 2)) return [0, 1];
      const place = (angle: number): number => Math.min(1, Math.max(0, 0.5 + 0.5 * (scale * Math.tan(angle) - shift)));
      return [place(middle - half), place(middle + half)];
    };
    const { elements } = camera.projectionMatrix;
    const [left, right] = along(x, elements[0] ?? 1, elements[8] ?? 0);
    const [bottom, top] = along(y, elements[5] ?? 1, elements[9] ?? 0);
    return [left, bottom, right, top];
  }

  /** Whether the mesh turns by itself, until someone moves it. */
  get isTurning(): boolean {
    return this.controls.autoRotate;
  }

  set isTurning(isOn: boolean) {
    this.controls.autoRotate = isOn;
  }

  /** Turns on by what time passed. */
  step(seconds: number): void {
    this.controls.update(seconds);
  }

  /** Puts the camera where all of a mesh is seen, from where it looks now or from the first direction. */
  fit(geometry: BufferGeometry, matrix: Matrix4, isFirst: boolean): void {
    this.extents = extentOf(geometry, matrix);
    this.look(this.extents, isFirst);
  }

  private look(extents: Extent, isFirst: boolean): void {
    const { camera, controls } = this;
    const { center } = extents.bounds;
    const direction = isFirst ? first(extents.places) : camera.position.clone().sub(controls.target);
    const distance = this.distanceFor(extents, direction.normalize());
    camera.position.copy(center).addScaledVector(direction, distance);
    camera.near = distance / 200;
    camera.far = distance * 20;
    camera.updateProjectionMatrix();
    controls.target.copy(center);
    controls.update();
  }

  /** From how far away all is seen in a direction. */
  private distanceFor({ places, bounds }: Extent, direction: Vector3): number {
    const half = (this.camera.fov * Math.PI) / 360;
    const { high, wide } = this.free;
    if (this.room !== null) return (this.room * bounds.radius || 1) / Math.sin(half) / Math.min(high, wide);
    const right = new Vector3(0, 1, 0).cross(direction).normalize();
    const up = direction.clone().cross(right);
    const [across, along] = [wide * Math.tan(half), high * Math.tan(half)];
    const place = new Vector3();
    let distance = 0;
    for (let i = 0; i + 2 < places.length; i += 3) {
      place.fromArray(places, i).sub(bounds.center);
      const beside = Math.max(Math.abs(place.dot(right)) / across, Math.abs(place.dot(up)) / along);
      distance = Math.max(distance, place.dot(direction) + MARGIN * beside);
    }
    return Math.max(distance, MARGIN * bounds.radius) || 1;
  }

  /** Looks from a direction, as far as it is not seen already; from none, which is 0, not. */
  face(direction: Vector3): void {
    const { camera, controls } = this;
    const offset = camera.position.clone().sub(controls.target);
    if (direction.lengthSq() === 0 || direction.dot(offset) > SEEN * offset.length()) return;
    camera.position.copy(controls.target).addScaledVector(direction, offset.length());
    controls.update();
  }

  /** Sees as much of the mesh as before, in the middle of what is not covered. */
  setSize(width: number, height: number, { top, bottom }: Covered): void {
    const { camera, controls, extents } = this;
    const direction = camera.position.clone().sub(controls.target).normalize();
    const distance = (): number => (extents ? this.distanceFor(extents, direction) : 1);
    const before = distance();
    this.free = { high: Math.max(0.3, 1 - (top + bottom) / height), wide: width / height };
    const by = distance() / before;
    camera.aspect = width / height;
    camera.setViewOffset(width, height, 0, (bottom - top) / 2, width, height);
    if (by === 1) return;
    camera.position.sub(controls.target).multiplyScalar(by).add(controls.target);
    controls.update();
  }

  dispose(): void {
    this.controls.dispose();
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
    if (event.key === "0" && this.extents) this.look(this.extents, true);
    const turn = turns[event.key];
    if (!turn || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    this.isTurning = false;
    const offset = this.camera.position.clone().sub(this.controls.target);
    const place = new Spherical().setFromVector3(offset);
    place.theta += turn[0];
    place.phi += turn[1];
    place.radius *= turn[2];
    this.camera.position.copy(this.controls.target).add(offset.setFromSpherical(place.makeSafe()));
    this.controls.update();
  }
}

/** The first direction, by height over base. */
function first(places: Float32Array): Vector3 {
  const { min, max } = new Box3().setFromArray(places);
  const base = Math.max(max.x - min.x, max.z - min.z);
  const flatness = 1 - Math.min(1, (max.y - min.y) / (base || 1));
  return FIRST.clone().setY(FIRST.y + RAISED * flatness);
}
