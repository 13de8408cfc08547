// The first pass: which triangle every pixel shows, and how it is lit. New labels or colours need only the second pass
// (paint.ts), whose time does not depend on the mesh. Triangles are drawn without an index, so `gl_VertexID / 3` is the
// triangle; normals are screen derivatives.

import {
  BufferAttribute,
  BufferGeometry,
  type Camera,
  type DataTexture,
  DoubleSide,
  GLSL3,
  Group,
  IntType,
  LineSegments,
  Mesh,
  NearestFilter,
  NoBlending,
  RGIntegerFormat,
  RawShaderMaterial,
  Scene,
  Uint32BufferAttribute,
  UnsignedIntType,
  Vector3,
  type Vector4,
  WebGLRenderTarget,
  type WebGLRenderer,
} from "three";

import { coarsen } from "./coarse";
import type { Rig } from "./rig";

/** A pixel that shows an edge of the remesh. */
export const EDGE = 0xffffffff;

/** Pixels around a place in which a triangle is looked for, where an edge is in the way. */
const REACH = 2;

/** Part of the length of an edge by which the mesh is behind it. */
const STEP_BACK = 0.2;

const SQUARE = new Float32Array([-0.5, 0, 0.5, 0.5, 0, 0.5, 0.5, 0, -0.5, -0.5, 0, 0.5, 0.5, 0, -0.5, -0.5, 0, -0.5]);

const VERTEX = `
precision highp float;
precision highp int;
uniform mat4 modelViewMatrix, projectionMatrix;
in vec3 position;
#ifdef IS_COARSE
in uint source;
#endif
flat out uint triangle;
out vec3 place;
void main() {
#ifdef IS_COARSE
  triangle = source;
#else
  triangle = uint(gl_VertexID) / 3u;
#endif
  vec4 view = modelViewMatrix * vec4(position, 1.0);
  place = view.xyz;
  gl_Position = projectionMatrix * view;
}`;

/** Light from the sky, from a lamp at the upper left of the viewer, and how far the surface faces the viewer. */
const FRAGMENT = `
precision highp float;
precision highp int;
uniform vec3 up;
flat in uint triangle;
in vec3 place;
out uvec2 seen;
void main() {
  vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
  float sky = 0.5 + 0.5 * dot(normal, up);
  float lamp = max(0.0, dot(normal, normalize(vec3(-0.45, 0.65, 0.6))));
  float facing = abs(dot(normal, normalize(place)));
  uvec3 light = uvec3(255.0 * clamp(vec3(sky, lamp, facing), 0.0, 1.0) + 0.5);
  seen = uvec2(triangle + 1u, light.x | light.y << 8 | light.z << 16);
}`;

/** No triangle, and how dark the shadow is. */
const GROUND_VERTEX = `
precision highp float;
uniform mat4 modelViewMatrix, projectionMatrix;
in vec3 position;
out vec2 place;
void main() {
  place = position.xz + 0.5;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

const GROUND_FRAGMENT = `
precision highp float;
precision highp int;
uniform sampler2D shadow;
in vec2 place;
out uvec2 seen;
void main() {
  seen = uvec2(0u, 255.0 * texture(shadow, place).r + 0.5);
}`;

const EDGE_VERTEX = `
precision highp float;
uniform mat4 modelViewMatrix, projectionMatrix;
in vec3 position;
void main() {
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

const EDGE_FRAGMENT = `
precision highp float;
precision highp int;
out uvec2 seen;
void main() {
  seen = uvec2(${EDGE}u, 0u);
}`;

export class Seen {
  /** The mesh and what lies over it, turned so that y is up. */
  readonly object = new Group();
  private readonly scene = new Scene();
  private readonly up = new Vector3();
  private readonly materials = [false, true].map((isCoarse) => this.material(isCoarse));
  private readonly target: WebGLRenderTarget;
  private coarse: Mesh<BufferGeometry, RawShaderMaterial> | null = null;
  private readonly whole: Mesh<BufferGeometry, RawShaderMaterial>;
  private readonly edges = new LineSegments(
    new BufferGeometry(),
    new RawShaderMaterial({ vertexShader: EDGE_VERTEX, fragmentShader: EDGE_FRAGMENT, glslVersion: GLSL3 }),
  );

  private readonly shadow: { value: DataTexture | null } = { value: null };
  /** A square of side 1 that is seen from above. Everything is above it, so it is drawn first. */
  private readonly ground = new Mesh(
    new BufferGeometry().setAttribute("position", new BufferAttribute(SQUARE, 3)),
    new RawShaderMaterial({
      vertexShader: GROUND_VERTEX,
      fragmentShader: GROUND_FRAGMENT,
      glslVersion: GLSL3,
      blending: NoBlending,
      depthTest: false,
      depthWrite: false,
      uniforms: { shadow: this.shadow },
    }),
  );

  constructor(
    private readonly renderer: WebGLRenderer,
    geometry: BufferGeometry,
  ) {
    this.whole = new Mesh(geometry, this.materials[0]);
    this.target = new WebGLRenderTarget(1, 1, {
      format: RGIntegerFormat,
      type: UnsignedIntType,
      internalFormat: "RG32UI",
      minFilter: NearestFilter,
      magFilter: NearestFilter,
    });
    this.edges.visible = false;
    this.object.add(this.whole, this.edges);
    this.ground.renderOrder = -1;
    this.scene.add(this.object, this.ground);
  }

  get texture(): WebGLRenderTarget["texture"] {
    return this.target.texture;
  }

  /** Puts the ground where a shadow lies. */
  setGround({ shadow, ground }: { shadow: DataTexture; ground: Vector4 }): void {
    this.ground.position.copy(ground);
    this.ground.scale.setScalar(ground.w);
    this.shadow.value?.dispose();
    this.shadow.value = shadow;
  }

  /** Makes a mesh of fewer triangles for moves; the triangle of the mesh that each stands for. */
  coarsen(whole: Float32Array): Uint32Array {
    const { positions, sources } = coarsen(whole);
    const corners = new Uint32Array(3 * sources.length);
    for (let i = 0; i < corners.length; i++) corners[i] = sources[Math.floor(i / 3)] ?? 0;
    const source = new Uint32BufferAttribute(corners, 1);
    source.gpuType = IntType;
    const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(positions, 3));
    this.coarse = new Mesh(geometry.setAttribute("source", source), this.materials[1]);
    this.object.add(this.coarse);
    return sources;
  }

  /** Draws edges over the mesh; none for null. Chords of a curved surface are below it, so the mesh steps back. */
  setEdges(segments: Float32Array | null, place: Vector3, rig: Rig): void {
    this.edges.geometry.dispose();
    this.edges.geometry = new BufferGeometry();
    if (segments) this.edges.geometry.setAttribute("position", new BufferAttribute(segments, 3));
    this.edges.visible = segments !== null;
    this.edges.position.copy(place);
    for (const material of this.materials) material.polygonOffsetUnits = segments ? unitsBehind(segments, rig) : 1;
  }

  draw(camera: Camera, width: number, height: number, isCoarse: boolean): void {
    if (this.target.width !== width || this.target.height !== height) this.target.setSize(width, height);
    camera.updateMatrixWorld();
    this.up.set(0, 1, 0).transformDirection(camera.matrixWorldInverse);
    this.whole.visible = !isCoarse;
    if (this.coarse) this.coarse.visible = isCoarse;
    this.renderer.setRenderTarget(this.target);
    this.renderer.clear();
    this.renderer.render(this.scene, camera);
    this.renderer.setRenderTarget(null);
  }

  /** The triangle at a place of the target, from its lower left corner. */
  at(x: number, y: number): number | null {
    const side = 2 * REACH + 1;
    const pixels = new Uint32Array(4 * side * side);
    const gl = this.renderer.getContext() as WebGL2RenderingContext;
    this.renderer.setRenderTarget(this.target);
    gl.readPixels(x - REACH, y - REACH, side, side, gl.RGBA_INTEGER, gl.UNSIGNED_INT, pixels);
    this.renderer.setRenderTarget(null);
    const middle = pixels[4 * (REACH * side + REACH)] ?? 0;
    if (middle !== EDGE) return middle === 0 ? null : middle - 1;
    const beside = pixels.find((triangle, i) => i % 4 === 0 && triangle !== 0 && triangle !== EDGE);
    return beside === undefined ? null : beside - 1;
  }

  dispose(): void {
    this.target.dispose();
    this.coarse?.geometry.dispose();
    this.edges.geometry.dispose();
    this.ground.geometry.dispose();
    this.shadow.value?.dispose();
    for (const material of [...this.materials, this.edges.material, this.ground.material]) material.dispose();
  }

  private material(isCoarse: boolean): RawShaderMaterial {
    return new RawShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      glslVersion: GLSL3,
      side: DoubleSide,
      blending: NoBlending,
      polygonOffset: true,
      polygonOffsetFactor: 1,
      polygonOffsetUnits: 1,
      defines: isCoarse ? { IS_COARSE: "" } : {},
      uniforms: { up: { value: this.up } },
    });
  }
}

/** A part of the mean length of the edges, in units of a depth buffer of 24 bits at the distance of the mesh. */
function unitsBehind(segments: Float32Array, { camera, distance }: Rig): number {
  let sum = 0;
  for (let i = 0; i + 5 < segments.length; i += 6) {
    const along = (axis: number): number => (segments[i + 3 + axis] ?? 0) - (segments[i + axis] ?? 0);
    sum += Math.hypot(along(0), along(1), along(2));
  }
  const depth = (STEP_BACK * sum) / (segments.length / 6 || 1);
  return 1 + (depth * camera.near * 2 ** 24) / distance ** 2;
}
