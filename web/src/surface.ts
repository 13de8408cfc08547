// Triangles in the colours of labels. They are drawn without an index, so `gl_VertexID / 3` is the triangle; a fragment
// takes its label from a texture of integers and its normal from screen derivatives. New labels are one upload of that
// texture. The label is looked up for fragments, which are fewer than the corners of a large mesh.

import {
  type BufferGeometry,
  DataTexture,
  DoubleSide,
  GLSL3,
  Mesh,
  NearestFilter,
  RawShaderMaterial,
  RedIntegerFormat,
  UnsignedIntType,
} from "three";

import { GLSL } from "./colour";

/** Texels in a row of the texture of labels; every WebGL 2 device has as many. */
const WIDTH = 2048;

/** No cluster. */
const NONE = 0xffffffff;

const VERTEX = `
precision highp float;
precision highp int;
uniform mat4 modelViewMatrix, projectionMatrix;
in vec3 position;
flat out int triangle;
out vec3 place;
void main() {
  triangle = gl_VertexID / 3;
  vec4 view = modelViewMatrix * vec4(position, 1.0);
  place = view.xyz;
  gl_Position = projectionMatrix * view;
}`;

const FRAGMENT = `
precision highp float;
precision highp int;
uniform highp usampler2D labels;
uniform uint selected;
flat in int triangle;
in vec3 place;
out vec4 colour_out;
${GLSL}
void main() {
  uint label = texelFetch(labels, ivec2(triangle % ${WIDTH}, triangle / ${WIDTH}), 0).r;
  vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
  float light = 0.4 + 0.6 * abs(dot(normal, normalize(place)));
  vec3 base = label == ${NONE}u ? vec3(0.62) : colour(label);
  if (selected != ${NONE}u && label != selected) base = mix(base, vec3(0.55), 0.7);
  colour_out = vec4(base * light, 1.0);
}`;

export class Surface {
  readonly object: Mesh<BufferGeometry, RawShaderMaterial>;
  private readonly texture: DataTexture;
  private readonly texels: Uint32Array;

  /** `faces`: the face of each triangle; null where they are the same. The caller disposes of the geometry. */
  constructor(
    geometry: BufferGeometry,
    private readonly faces: Uint32Array | null,
  ) {
    const rows = Math.max(1, Math.ceil(geometry.getAttribute("position").count / 3 / WIDTH));
    this.texels = new Uint32Array(WIDTH * rows).fill(NONE);
    this.texture = new DataTexture(this.texels, WIDTH, rows, RedIntegerFormat, UnsignedIntType);
    this.texture.minFilter = this.texture.magFilter = NearestFilter;
    this.texture.needsUpdate = true;
    const material = new RawShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      glslVersion: GLSL3,
      side: DoubleSide,
      polygonOffset: true,
      polygonOffsetFactor: 1,
      polygonOffsetUnits: 1,
      uniforms: { labels: { value: this.texture }, selected: { value: NONE } },
    });
    this.object = new Mesh(geometry, material);
  }

  /** Colours the triangles by the labels of their faces. */
  setLabels(labels: Uint32Array): void {
    const { faces, texels } = this;
    if (faces) for (let i = 0; i < faces.length; i++) texels[i] = labels[faces[i] ?? 0] ?? NONE;
    else texels.set(labels.subarray(0, texels.length));
    this.texture.needsUpdate = true;
  }

  select(cluster: number | null): void {
    const { selected } = this.object.material.uniforms;
    if (selected) selected.value = cluster ?? NONE;
  }

  /** Draws the triangles as if they were behind their place, by units of the depth buffer. */
  stepBack(units: number): void {
    this.object.material.polygonOffsetUnits = units;
  }

  dispose(): void {
    this.texture.dispose();
    this.object.material.dispose();
  }
}
