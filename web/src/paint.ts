// The second pass: the colour of each pixel from the triangle that it shows, a texture of labels, one of colours, thin
// lines where labels differ, and the shadow on the ground.

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DataTexture,
  GLSL3,
  Matrix4,
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
  Vector4,
  type WebGLRenderer,
} from "three";

import { EDGE } from "./seen";

/** Texels in a row of a texture, a power of two; every WebGL 2 device has as many. */
const SHIFT = 11;
const WIDTH = 1 << SHIFT;

/** No cluster. */
const NONE = 0xffffffff;

const VERTEX = `
in vec3 position;
uniform mat4 toWorld;
out vec4 near, far;
void main() {
  near = toWorld * vec4(position.xy, -1.0, 1.0);
  far = toWorld * vec4(position.xy, 1.0, 1.0);
  gl_Position = vec4(position, 1.0);
}`;

const FRAGMENT = `
precision highp float;
precision highp int;
uniform highp usampler2D seen, labels;
uniform sampler2D colours, shadow;
uniform ivec2 size;
uniform vec2 origin;
uniform int finer;
uniform uint selected, hovered;
uniform vec3 background, faded, ink;
uniform vec4 ground;
in vec4 near, far;
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

vec3 behind() {
  vec3 from = near.xyz / near.w;
  vec3 along = far.xyz / far.w - from;
  if (from.y < ground.y || along.y >= 0.0) return background;
  vec2 hit = (from + along * (ground.y - from.y) / along.y).xz;
  vec2 at_shadow = 0.5 + (hit - ground.xz) / ground.w;
  if (any(greaterThan(abs(at_shadow - 0.5), vec2(0.5)))) return background;
  return background * (1.0 - texture(shadow, at_shadow).r);
}

vec3 colour_at(ivec2 at, int pace) {
  uvec2 here = texelFetch(seen, at, 0).rg;
  if (here.r == 0u) return behind();
  if (here.r == ${EDGE}u) return ink;
  uint label = label_of(here.r);
  vec3 base = label == ${NONE}u ? vec3(0.73, 0.73, 0.72)
    : texelFetch(colours, texel(label), 0).rgb;
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
  if (!is_border) return lit;
  return stands_out ? ink : mix(lit, 0.34 * lit, SAMPLES > 1 ? 0.8 : 0.55);
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
  shadow: Texture;
  /** Centre of the ground, its height as y, and the side of its shadow. */
  ground: Vector4;
  toWorld: Matrix4;
  /** Pixels of the first pass along one of the canvas, and how many of them are looked at. */
  finer: number;
  samples: number;
  background: Color;
  faded: Color;
  ink: Color;
}

/** The mesh in the colours of one set of labels. */
export class Paint {
  private readonly labels: DataTexture;
  private readonly texels: Uint32Array;
  private colours: DataTexture;
  private readonly uniforms: Record<string, { value: unknown }>;
  /** One for each number of samples: a software renderer computes both sides of a branch. */
  private readonly materials: RawShaderMaterial[];
  private readonly screen: Mesh;
  private readonly camera = new OrthographicCamera();

  constructor(
    triangles: number,
    /** The face of each triangle; null where they are the same. */
    private readonly faces: Uint32Array | null,
  ) {
    const rows = Math.max(1, Math.ceil(triangles / WIDTH));
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
    this.materials = [1, 2].map(
      (samples) =>
        new RawShaderMaterial({
          vertexShader: VERTEX,
          fragmentShader: FRAGMENT,
          glslVersion: GLSL3,
          depthTest: false,
          depthWrite: false,
          defines: { SAMPLES: samples },
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
    this.colours = coloursOf(colours);
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
    this.screen.material = this.materials[samples - 1] as RawShaderMaterial;
    renderer.render(this.screen, this.camera);
  }

  dispose(): void {
    this.labels.dispose();
    this.colours.dispose();
    for (const material of this.materials) material.dispose();
    this.screen.geometry.dispose();
  }

  /** Sets a uniform; whether it changed. */
  private give(name: string, value: unknown): boolean {
    const uniform = (this.uniforms[name] ??= { value: null });
    const changed = uniform.value !== value;
    uniform.value = value;
    return changed;
  }
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

/** The colours of a box: its borders, which are not drawn, have those of lines and of clusters that are not selected. */
export function themeOf(box: HTMLElement): Pick<Frame, "background" | "faded" | "ink"> {
  const style = getComputedStyle(box);
  const colour = (text: string): Color => new Color().setStyle(text, "srgb-linear");
  return {
    background: colour(style.backgroundColor),
    faded: colour(style.borderBottomColor),
    ink: colour(style.borderTopColor),
  };
}
