// The camera around the mesh: by pointer, by keys, and turning by itself.

import { PerspectiveCamera, type Sphere, Spherical, Vector3 } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

/** Angle of a turn by a key. */
const TURN = Math.PI / 24;

/** Turns a minute, of a mesh that turns by itself. */
const TURNS = 1.2;

/** Cosine of the angle between a normal and the camera up to which a cluster is seen well. */
const SEEN = 0.4;

const FIRST = new Vector3(0.5, 0.34, 1);

export class Rig {
  /** Called after every move. */
  onMove: () => void = () => {};
  /** Radius of what is in sight at first, in radii of the mesh. */
  room = 1.1;
  readonly camera = new PerspectiveCamera(30, 1, 0.01, 100);
  private readonly controls: OrbitControls;
  private bounds: Sphere | null = null;

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

  /** Puts the camera where the whole of a sphere is seen, from where it looks now or from the first direction. */
  fit(bounds: Sphere, isFirst: boolean): void {
    this.bounds = bounds;
    const direction = isFirst ? FIRST.clone() : this.camera.position.clone().sub(this.controls.target);
    const { center, radius } = bounds;
    const narrow = Math.min(1, this.camera.aspect);
    const distance = (this.room * radius || 1) / Math.sin((this.camera.fov * Math.PI) / 360) / narrow;
    this.camera.position.copy(center).addScaledVector(direction.normalize(), distance);
    this.camera.near = distance / 200;
    this.camera.far = distance * 20;
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(center);
    this.controls.update();
  }

  /** Looks from a direction, as far as it is not seen already; from none, which is 0, not. */
  face(direction: Vector3): void {
    const { camera, controls } = this;
    const offset = camera.position.clone().sub(controls.target);
    if (direction.lengthSq() === 0 || direction.dot(offset) > SEEN * offset.length()) return;
    camera.position.copy(controls.target).addScaledVector(direction, offset.length());
    controls.update();
  }

  /** Sees as much of the mesh as before. */
  setAspect(aspect: number): void {
    const { camera, controls } = this;
    const by = Math.min(1, camera.aspect) / Math.min(1, aspect);
    camera.aspect = aspect;
    camera.updateProjectionMatrix();
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
    if (event.key === "0" && this.bounds) this.fit(this.bounds, true);
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
