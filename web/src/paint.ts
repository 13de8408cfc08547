// The second pass: the colour of each pixel from what it shows, a texture of labels, one of colours, and thin lines where
// labels differ, which are fainter around clusters of a few pixels: they would cover them.

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DataTexture,
  GLSL3,
  Mesh,
  NearestFilter,
  OrthographicCamera,
  RGBAFormat,
  RawShaderMaterial,
  RedIntegerFormat,
  type Texture,
  UnsignedByteType,
  UnsignedIntType,
  Vector2,
  type WebGLRenderer,
} from "three";

import type { Triangles } from "./drawable";
import { EDGE } from "./seen";

/** Texels in a row of a texture, a power of two; every WebGL 2 device has as many. */
const SHIFT = 11;
const WIDTH = 1 << SHIFT;

/** No cluster. */
const NONE = 0xffffffff;

/** Width of a cluster in pixels up to which it has no lines, and from which on they are whole. */
const [NARROW, WIDE] = [2, 9];

/** Part of the canvas at its edges in which a shadow ends. */
const SHADOW_END = 0.12;

/** Alphas of colours are logarithms of widths: so many a doubling, and 255 at the radius of the mesh. */
const DOUBLING = 16;

const VERTEX = `
in vec3 position;
void main() {
  gl_Position = vec4(position, 1.0);
}`;

const FRAGMENT = `
precision highp float;
precision highp int;
uniform highp usampler2D seen, labels;
uniform sampler2D colours;
uniform ivec2 size;
uniform vec2 origin;
uniform int finer, outline;
uniform float radius;
uniform uint selected, hovered;
uniform vec3 background, faded, ink;
out vec4 colour_out;

const uint BEHIND = 0xfffffffeu;

// divisions of integers take a software renderer long
ivec2 texel(uint i) {
  return ivec2(i & ${WIDTH - 1}u, i >> ${SHIFT});
}

uint label_of(uint triangle) {
  if (triangle == 0u) return BEHIND;
  return texelFetch(labels, texel(triangle - 1u), 0).r;
}

bool differs(uint label, ivec2 at) {
  uint triangle = texelFetch(seen, clamp(at, ivec2(0), size - 1), 0).r;
  return triangle != ${EDGE}u && label_of(triangle) != label;
}

#ifdef HAS_OUTLINE
bool ends_within(uint label, ivec2 at, int reach) {
  int corner = reach * 7 / 10;
  return differs(label, at + ivec2(reach, 0)) || differs(label, at - ivec2(reach, 0))
    || differs(label, at + ivec2(0, reach)) || differs(label, at - ivec2(0, reach))
    || differs(label, at + corner) || differs(label, at - corner)
    || differs(label, at + ivec2(corner, -corner)) || differs(label, at + ivec2(-corner, corner));
}
#endif

vec3 colour_at(ivec2 at, int pace) {
  uvec2 here = texelFetch(seen, at, 0).rg;
  if (here.r == 0u) {
    // the shadow ends before the canvas does
    vec2 inside = vec2(min(at, size - at)) / (${SHADOW_END} * vec2(size));
    return background * (1.0 - float(here.g) / 255.0 * min(1.0, min(inside.x, inside.y)));
  }
  if (here.r == ${EDGE}u) return ink;
  uint label = label_of(here.r);
  vec4 cluster = label == ${NONE}u ? vec4(0.73, 0.73, 0.72, 1.0) : texelFetch(colours, texel(label), 0);
  vec3 base = cluster.rgb;
  bool stands_out = label != ${NONE}u && (label == selected || label == hovered);
  if (selected != ${NONE}u && !stands_out) base = mix(base, faded, 0.72);
  if (label == hovered && label != selected) base = mix(base, vec3(1.0), 0.3);
  vec3 light = vec3(here.g & 255u, here.g >> 8 & 255u, here.g >> 16 & 255u) / 255.0;
  vec3 sky = mix(vec3(0.70, 0.66, 0.66), vec3(0.96, 0.98, 1.0), light.x);
  vec3 lit = base * (sky + 0.16 * light.y - 0.24 * (1.0 - light.z) * (1.0 - light.z));
  bool is_border = differs(label, at + ivec2(pace, 0)) || differs(label, at + ivec2(0, pace));
#if SAMPLES > 1
  if (!is_border) is_border = differs(label, at - ivec2(pace, 0)) || differs(label, at - ivec2(0, pace));
#endif
#ifdef HAS_OUTLINE
  if (stands_out && (is_border || ends_within(label, at, outline))) return ink;
#endif
  if (!is_border) return lit;
  // seen from the side, it is narrower
  float width = light.z * radius * exp2((255.0 * cluster.a - 255.0) / ${DOUBLING}.0);
  float strength = clamp((width - ${NARROW}.0) / ${WIDE - NARROW}.0, 0.0, 1.0);
  return mix(lit, 0.34 * lit, strength * (SAMPLES > 1 ? 0.8 : 0.55));
}

void main() {
  ivec2 first = ivec2(gl_FragCoord.xy - origin) * finer;
  int pace = finer / SAMPLES;
  vec3 colour = colour_at(first, pace);
#if SAMPLES > 1
  colour += colour_at(first + ivec2(pace, 0), pace) + colour_at(first + ivec2(0, pace), pace);
  colour = 0.25 * (colour + colour_at(first + pace, pace));
#endif
  colour_out = vec4(colour, 1.0);
}`;

/** What is the same in all panes of a frame. */
export interface Frame {
  seen: Texture;
  /** Pixels of the first pass along one of the canvas, and how many of them are looked at. */
  finer: number;
  samples: number;
  /** Those along the line around a cluster that is selected or under the pointer. */
  outline: number;
  /** Pixels of the canvas along the radius of the mesh. */
  radius: number;
  background: Color;
  faded: Color;
  ink: Color;
}

/** The mesh in the colours of one set of labels. */
export class Paint {
  /** The face of each triangle; null where they are the same. */
  private readonly faces: Uint32Array | null;
  private readonly areas: Float32Array;
  private readonly labels: DataTexture;
  private readonly texels: Uint32Array;
  private colours: DataTexture;
  private readonly uniforms: Record<string, { value: unknown }>;
  /** One for each number of samples, with and without an outline: a software renderer computes both sides of a branch. */
  private readonly materials: RawShaderMaterial[];
  private readonly screen: Mesh;
  private readonly camera = new OrthographicCamera();

  constructor({ positions, faces }: Triangles, radius: number) {
    this.faces = faces;
    this.areas = areasOf(positions, radius || 1);
    const rows = Math.max(1, Math.ceil(this.areas.length / WIDTH));
    this.texels = new Uint32Array(WIDTH * rows).fill(NONE);
    this.labels = new DataTexture(this.texels, WIDTH, rows, RedIntegerFormat, UnsignedIntType);
    this.labels.minFilter = this.labels.magFilter = NearestFilter;
    this.labels.needsUpdate = true;
    this.colours = coloursOf(new Uint8Array(4));
    this.uniforms = {
      labels: { value: this.labels },
      colours: { value: this.colours },
      selected: { value: NONE },
      hovered: { value: NONE },
      size: { value: new Vector2() },
      origin: { value: new Vector2() },
    };
    this.materials = [
      { SAMPLES: 1 },
      { SAMPLES: 2 },
      { SAMPLES: 1, HAS_OUTLINE: "" },
      { SAMPLES: 2, HAS_OUTLINE: "" },
    ].map(
      (defines) =>
        new RawShaderMaterial({
          vertexShader: VERTEX,
          fragmentShader: FRAGMENT,
          glslVersion: GLSL3,
          depthTest: false,
          depthWrite: false,
          defines,
          uniforms: this.uniforms,
        }),
    );
    const triangle = new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]);
    this.screen = new Mesh(
      new BufferGeometry().setAttribute("position", new BufferAttribute(triangle, 3)),
      this.materials[0],
    );
    this.screen.frustumCulled = false;
  }

  /** Labels of faces, and four bytes a cluster. */
  set(labels: Uint32Array, colours: Uint8Array): void {
    const { faces, texels } = this;
    if (faces) for (let i = 0; i < faces.length; i++) texels[i] = labels[faces[i] ?? 0] ?? NONE;
    else texels.set(labels.subarray(0, texels.length));
    this.labels.needsUpdate = true;
    this.colours.dispose();
    this.colours = coloursOf(this.withWidths(colours));
    this.give("colours", this.colours);
  }

  select(cluster: number | null): boolean {
    return this.give("selected", cluster ?? NONE);
  }

  hover(cluster: number | null): boolean {
    return this.give("hovered", cluster ?? NONE);
  }

  /** Draws into the viewport that is set, whose lower left pixel is `origin`. */
  draw(renderer: WebGLRenderer, frame: Frame, x: number, y: number, width: number, height: number): void {
    const { samples, ...values } = frame;
    for (const [name, value] of Object.entries(values)) this.give(name, value);
    (this.uniforms["origin"]?.value as Vector2).set(x, y);
    (this.uniforms["size"]?.value as Vector2).set(width, height);
    const hasOutline = this.uniforms["selected"]?.value !== NONE || this.uniforms["hovered"]?.value !== NONE;
    this.screen.material = this.materials[samples - 1 + (hasOutline ? 2 : 0)] as RawShaderMaterial;
    renderer.render(this.screen, this.camera);
  }

  dispose(): void {
    this.labels.dispose();
    this.colours.dispose();
    for (const material of this.materials) material.dispose();
    this.screen.geometry.dispose();
  }

  /** Colours whose alphas say how wide clusters are. */
  private withWidths(colours: Uint8Array): Uint8Array {
    const { areas, texels } = this;
    const sums = new Float32Array(colours.length / 4);
    // this runs at every frame of a moving slider
    for (let i = 0; i < areas.length; i++) {
      const label = texels[i] as number;
      sums[label] = (sums[label] as number) + (areas[i] as number);
    }
    const widths = colours.slice();
    for (let i = 0; i < sums.length; i++)
      widths[4 * i + 3] = Math.max(0, Math.min(255, 255 + (DOUBLING / 2) * Math.log2(sums[i] as number)));
    return widths;
  }

  /** Sets a uniform; whether it changed. */
  private give(name: string, value: unknown): boolean {
    const uniform = (this.uniforms[name] ??= { value: null });
    const changed = uniform.value !== value;
    uniform.value = value;
    return changed;
  }
}

/** The area of each triangle, in squares of a radius. */
function areasOf(positions: Float32Array, radius: number): Float32Array {
  const areas = new Float32Array(positions.length / 9);
  const along = (i: number): number => ((positions[i] as number) - (positions[i - 3] as number)) / radius;
  for (let t = 0, i = 3; t < areas.length; t++, i += 9) {
    const x = along(i + 1) * along(i + 5) - along(i + 2) * along(i + 4);
    const y = along(i + 2) * along(i + 3) - along(i) * along(i + 5);
    const z = along(i) * along(i + 4) - along(i + 1) * along(i + 3);
    areas[t] = Math.sqrt(x * x + y * y + z * z) / 2;
  }
  return areas;
}

function coloursOf(bytes: Uint8Array): DataTexture {
  const rows = Math.max(1, Math.ceil(bytes.length / 4 / WIDTH));
  const texels = new Uint8Array(4 * WIDTH * rows);
  texels.set(bytes);
  const texture = new DataTexture(texels, WIDTH, rows, RGBAFormat, UnsignedByteType);
  texture.minFilter = texture.magFilter = NearestFilter;
  texture.needsUpdate = true;
  return texture;
}

/** The colours of a box: its borders, which are not drawn, have those of lines, faded clusters and the background. */
export function themeOf(box: HTMLElement): Pick<Frame, "background" | "faded" | "ink"> {
  const style = getComputedStyle(box);
  const colour = (text: string): Color => new Color().setStyle(text, "srgb-linear");
  return {
    background: colour(style.borderLeftColor),
    faded: colour(style.borderBottomColor),
    ink: colour(style.borderTopColor),
  };
}
