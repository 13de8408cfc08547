// Which way is up, and the soft shadow of the mesh on the ground under it, made once for a mesh.

import { DataTexture, LinearFilter, RedFormat, UnsignedByteType, Vector4 } from "three";

export type Up = "y" | "z";

/** Texels along the shadow. */
const SIDE = 128;

/** The shadow's side, in lengths of the longer side of the mesh's base. */
const EXTENT = 2.2;

/** Most triangles that the shadow is made of. */
const MOST = 200_000;

/** Height, in lengths of the mesh's base, at which a triangle's shadow is a third. */
const FADE = 0.35;

/** A part of the height at each end in which a base is looked for. */
const BASE = 0.02;

/** Formats whose definition says that y is up. */
const UP_IS_Y = ["glb", "gltf"];

/** The least part of the box's side that a base covers. */
const LEAST = 0.02;

/** Cosine of the angle between a triangle of a base and the side. A rough rim is steeper. */
const FLAT = 0.9;

/**
 * Which way is up. glTF defines y. Elsewhere it is z where the base across z is flat and more than twice that across y,
 * unless the mesh were a tower then; without a base it is z for STL and for what is flat across z, as terrains are.
 */
export function guessUp(positions: Float32Array, format: string): Up {
  if (UP_IS_Y.includes(format)) return "y";
  const { low, high } = bounds(positions);
  const base = { y: 0, z: 0 };
  const pace = 9 * Math.max(1, Math.floor(positions.length / 9 / MOST));
  for (let i = 0; i < positions.length; i += pace) {
    for (const [name, axis] of [
      ["y", 1],
      ["z", 2],
    ] as const) {
      const [a, b] = [(axis + 1) % 3, (axis + 2) % 3];
      const end = (low[axis] ?? 0) + BASE * ((high[axis] ?? 0) - (low[axis] ?? 0));
      const at = (corner: number, along: number): number => positions[i + 3 * corner + along] ?? 0;
      if (at(0, axis) > end || at(1, axis) > end || at(2, axis) > end) continue;
      const across = (i: number, j: number): number =>
        (at(1, i) - at(0, i)) * (at(2, j) - at(0, j)) - (at(2, i) - at(0, i)) * (at(1, j) - at(0, j));
      const area = Math.abs(across(a, b)) / 2;
      if (area >= (FLAT / 2) * Math.hypot(across(a, b), across(b, axis), across(axis, a))) base[name] += area;
    }
  }
  const length = (axis: number): number => (high[axis] ?? 0) - (low[axis] ?? 0);
  const [width, depth, height] = [length(0), length(1), length(2)];
  const part = { y: base.y / (height * width || 1), z: base.z / (width * depth || 1) };
  const isTower = height > 2 * Math.max(width, depth);
  if (height === 0 || part.y > Math.max(LEAST, part.z / 2)) return "y";
  if (part.z > LEAST) return isTower ? "y" : "z";
  return height < 0.4 * Math.min(width, depth) || format === "stl" ? "z" : "y";
}

/** The shadow, and where it lies: centre, height as y, and side. */
export function groundOf(positions: Float32Array, up: Up): { shadow: DataTexture; ground: Vector4 } {
  const { low, high } = bounds(positions);
  const [across, height, sign] = up === "y" ? [2, 1, 1] : [1, 2, -1];
  const middle = (axis: number): number => ((low[axis] ?? 0) + (high[axis] ?? 0)) / 2;
  const length = (axis: number): number => (high[axis] ?? 0) - (low[axis] ?? 0);
  const base = Math.max(length(0), length(across), 0.3 * length(height)) || 1;
  const side = EXTENT * base;
  const floor = low[height] ?? 0;
  const density = new Float32Array(SIDE * SIDE);
  const pace = 9 * Math.max(1, Math.floor(positions.length / 9 / MOST));
  const texel = (place: number, centre: number): number => Math.floor((0.5 + (place - centre) / side) * SIDE);
  for (let i = 0; i < positions.length; i += pace) {
    const mean = (axis: number): number =>
      ((positions[i + axis] ?? 0) + (positions[i + 3 + axis] ?? 0) + (positions[i + 6 + axis] ?? 0)) / 3;
    const strength = Math.exp(-(mean(height) - floor) / (FADE * base));
    const x = texel(mean(0), middle(0));
    const z = texel(sign * mean(across), sign * middle(across));
    const at = SIDE * z + x;
    density[at] = Math.max(density[at] ?? 0, strength);
  }
  // blurred little and much: dark at the contact, wide and faint around it
  const near = blur(density, 3);
  const wide = blur(density, 11);
  const texels = Uint8Array.from(near, (value, i) => Math.min(255, 255 * (0.3 * value + 0.42 * (wide[i] ?? 0))));
  const shadow = new DataTexture(texels, SIDE, SIDE, RedFormat, UnsignedByteType);
  shadow.minFilter = shadow.magFilter = LinearFilter;
  shadow.needsUpdate = true;
  return { shadow, ground: new Vector4(middle(0), floor, sign * middle(across), side) };
}

/** Three passes of a mean over a square, which are close to a Gaussian. */
function blur(image: Float32Array, reach: number): Float32Array {
  let [from, to] = [image.slice(), new Float32Array(image.length)];
  for (let pass = 0; pass < 6; pass++) {
    const [along, across] = pass % 2 === 0 ? [1, SIDE] : [SIDE, 1];
    for (let row = 0; row < SIDE; row++) {
      let sum = 0;
      for (let i = -reach; i < SIDE; i++) {
        const enters = i + reach;
        if (enters < SIDE) sum += from[row * across + enters * along] ?? 0;
        if (i - reach > 0) sum -= from[row * across + (i - reach - 1) * along] ?? 0;
        if (i >= 0) to[row * across + i * along] = sum / (2 * reach + 1);
      }
    }
    [from, to] = [to, from];
  }
  return from;
}

function bounds(positions: Float32Array): { low: number[]; high: number[] } {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < positions.length; i++) {
    const [axis, place] = [i % 3, positions[i] ?? 0];
    if (place < (low[axis] ?? 0)) low[axis] = place;
    if (place > (high[axis] ?? 0)) high[axis] = place;
  }
  return { low, high };
}
