// The mesh in 3D, coloured by cluster. Triangles are drawn without an index, so `gl_VertexID / 3` is the triangle; its
// label comes from a texture of integers, its normal from screen derivatives. New labels are one upload of that
// texture.

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DataTexture,
  DoubleSide,
  GLSL3,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  NearestFilter,
  PerspectiveCamera,
  RawShaderMaterial,
  RedIntegerFormat,
  Scene,
  Sphere,
  Spherical,
  UnsignedIntType,
  Vector2,
  Vector3,
  WebGLRenderTarget,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import { GLSL } from "./colour";

/** Triangles of a mesh in upload order: nine numbers each, about `centre`. */
export interface Triangles {
  positions: Float32Array;
  centre: Vector3;
  /** The face of each triangle; null where every face is a triangle. */
  faces: Uint32Array | null;
}

/** Texels in a row of the texture of labels; every WebGL 2 device has as many. */
const WIDTH = 2048;

/** Angle of a turn by a key. */
const TURN = Math.PI / 24;

/** Part of the length of an edge by which the mesh is behind it. */
const STEP_BACK = 0.2;

/** No cluster. */
const NONE = 0xffffffff;

const VERTEX = `
precision highp float;
precision highp int;
uniform highp usampler2D labels;
uniform mat4 modelViewMatrix, projectionMatrix;
in vec3 position;
flat out uint triangle, label;
out vec3 place;
void main() {
  int number = gl_VertexID / 3;
  triangle = uint(number);
  label = texelFetch(labels, ivec2(number % ${WIDTH}, number / ${WIDTH}), 0).r;
  vec4 view = modelViewMatrix * vec4(position, 1.0);
  place = view.xyz;
  gl_Position = projectionMatrix * view;
}`;

const FRAGMENT = `
precision highp float;
precision highp int;
uniform bool picking;
uniform uint selected;
flat in uint triangle, label;
in vec3 place;
out vec4 colour_out;
${GLSL}
void main() {
  if (picking) {
    uint id = triangle + 1u;
    colour_out = vec4(uvec4(id, id >> 8, id >> 16, id >> 24) & 255u) / 255.0;
    return;
  }
  vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
  float light = 0.4 + 0.6 * abs(dot(normal, normalize(place)));
  vec3 base = label == ${NONE}u ? vec3(0.62) : colour(label);
  if (selected != ${NONE}u && label != selected) base = mix(base, vec3(0.55), 0.7);
  colour_out = vec4(base * light, 1.0);
}`;

export class View {
  /** Called with the triangle under a click, or null, and whether Shift was held. */
  onPick: (triangle: number | null, withShift: boolean) => void = () => {};
  /** Frames drawn. */
  frames = 0;
  readonly canvas: HTMLCanvasElement;

  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly camera = new PerspectiveCamera(35, 1, 0.01, 100);
  private readonly controls: OrbitControls;
  private readonly geometry = new BufferGeometry();
  private readonly texture: DataTexture;
  private readonly material: RawShaderMaterial;
  private readonly lines = new Group();
  private readonly bounds: Sphere;
  private readonly observer: ResizeObserver;
  private pending = 0;

  constructor(
    private readonly box: HTMLElement,
    private readonly mesh: Triangles,
  ) {
    this.renderer = new WebGLRenderer({ antialias: true, powerPreference: "high-performance" });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.canvas = this.renderer.domElement;
    this.geometry.setAttribute("position", new BufferAttribute(mesh.positions, 3));
    this.geometry.computeBoundingSphere();
    this.bounds = this.geometry.boundingSphere ?? new Sphere();

    const rows = Math.max(1, Math.ceil(this.triangles / WIDTH));
    const texels = new Uint32Array(WIDTH * rows).fill(NONE);
    this.texture = new DataTexture(texels, WIDTH, rows, RedIntegerFormat, UnsignedIntType);
    this.texture.minFilter = this.texture.magFilter = NearestFilter;
    this.texture.needsUpdate = true;
    this.material = new RawShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      glslVersion: GLSL3,
      side: DoubleSide,
      polygonOffset: true,
      polygonOffsetFactor: 1,
      polygonOffsetUnits: 1,
      uniforms: { labels: { value: this.texture }, picking: { value: false }, selected: { value: NONE } },
    });
    this.scene.add(new Mesh(this.geometry, this.material), this.lines);

    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.addEventListener("change", () => this.draw());
    this.fit();
    box.replaceChildren(this.canvas);
    this.canvas.tabIndex = 0;
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    this.listenToClicks();
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(box);
    this.resize();
  }

  get triangles(): number {
    return this.mesh.positions.length / 9;
  }

  /** Colours the triangles by the labels of their faces. */
  setLabels(labels: Uint32Array): void {
    const texels = this.texture.image.data as Uint32Array;
    const { faces } = this.mesh;
    if (faces) for (let i = 0; i < faces.length; i++) texels[i] = labels[faces[i] ?? 0] ?? NONE;
    else texels.set(labels.subarray(0, this.triangles));
    this.texture.needsUpdate = true;
    this.draw();
  }

  select(cluster: number | null): void {
    this.uniform("selected", cluster ?? NONE);
    this.draw();
  }

  /** Draws edges over the mesh; none for null. Chords of a curved surface are below it, so the mesh steps back. */
  setLines(segments: Float32Array | null, centre = new Vector3()): void {
    this.clearLines();
    this.material.polygonOffsetUnits = segments ? this.stepBack(segments) : 1;
    if (segments) {
      const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(segments, 3));
      this.lines.add(new LineSegments(geometry, new LineBasicMaterial({ color: 0x101010 })));
      this.lines.position.copy(centre).sub(this.mesh.centre);
    }
    this.draw();
  }

  dispose(): void {
    cancelAnimationFrame(this.pending);
    this.observer.disconnect();
    this.controls.dispose();
    this.clearLines();
    this.geometry.dispose();
    this.texture.dispose();
    this.material.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.canvas.remove();
  }

  /** Draws before the next frame of the browser, once for any number of changes. */
  private draw(): void {
    this.pending ||= requestAnimationFrame(() => {
      this.pending = 0;
      this.scene.background = new Color(getComputedStyle(this.box).backgroundColor);
      this.renderer.render(this.scene, this.camera);
      this.frames++;
      this.canvas.dataset["frames"] = String(this.frames);
    });
  }

  private uniform(name: string, value: number | boolean): void {
    const uniform = this.material.uniforms[name];
    if (uniform) uniform.value = value;
  }

  /** A part of the mean length of the edges, in units of a depth buffer of 24 bits at the distance of the mesh. */
  private stepBack(segments: Float32Array): number {
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

  /** Puts the camera where the whole mesh is seen. */
  private fit(): void {
    const { center, radius } = this.bounds;
    const narrow = Math.min(1, (this.box.clientWidth || 1) / (this.box.clientHeight || 1));
    const distance = (1.05 * radius || 1) / Math.sin((this.camera.fov * Math.PI) / 360) / narrow;
    this.camera.position.copy(center).addScaledVector(new Vector3(0.45, 0.5, 1).normalize(), distance);
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
    this.camera.aspect = width / height;
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
    if (event.key === "0") this.fit();
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
      if (event.button === 0 && moved < 4) this.onPick(this.pick(event.offsetX, event.offsetY), event.shiftKey);
    });
  }

  /** The triangle at a place of the canvas: the scene drawn into one pixel, with numbers for colours. */
  private pick(x: number, y: number): number | null {
    const target = new WebGLRenderTarget(1, 1);
    this.camera.setViewOffset(this.box.clientWidth, this.box.clientHeight, x, y, 1, 1);
    this.uniform("picking", true);
    this.lines.visible = false;
    this.scene.background = null;
    this.renderer.setClearColor(0, 0);
    this.renderer.setRenderTarget(target);
    this.renderer.clear();
    this.renderer.render(this.scene, this.camera);
    const pixel = new Uint8Array(4);
    this.renderer.readRenderTargetPixels(target, 0, 0, 1, 1, pixel);
    this.renderer.setRenderTarget(null);
    this.lines.visible = true;
    this.uniform("picking", false);
    this.camera.clearViewOffset();
    target.dispose();
    const id = new DataView(pixel.buffer).getUint32(0, true);
    return id === 0 ? null : id - 1;
  }
}
