// The triangle under a place of the canvas: the one that a ray meets first (Möller and Trumbore 1997). Every triangle
// is tried, which takes some 30 ms for 1,000,000; to draw their numbers takes a software renderer 0.3 s and more.

import type { Vector3 } from "three";

/** The first triangle beyond `from` in a direction; nine numbers a triangle. */
export function meet(positions: Float32Array, from: Vector3, direction: Vector3): number | null {
  const [fx, fy, fz] = from.toArray();
  const [dx, dy, dz] = direction.toArray();
  const at = (i: number): number => positions[i] ?? 0;
  let found: number | null = null;
  let nearest = Infinity;
  // plain variables: arrays in their place took seven times the time
  for (let i = 0; i < positions.length; i += 9) {
    const x = at(i);
    const y = at(i + 1);
    const z = at(i + 2);
    const ux = at(i + 3) - x;
    const uy = at(i + 4) - y;
    const uz = at(i + 5) - z;
    const vx = at(i + 6) - x;
    const vy = at(i + 7) - y;
    const vz = at(i + 8) - z;
    const px = dy * vz - dz * vy;
    const py = dz * vx - dx * vz;
    const pz = dx * vy - dy * vx;
    const volume = ux * px + uy * py + uz * pz;
    if (volume === 0) continue;
    const sx = fx - x;
    const sy = fy - y;
    const sz = fz - z;
    const u = (sx * px + sy * py + sz * pz) / volume;
    if (u < 0 || u > 1) continue;
    const qx = sy * uz - sz * uy;
    const qy = sz * ux - sx * uz;
    const qz = sx * uy - sy * ux;
    const v = (dx * qx + dy * qy + dz * qz) / volume;
    if (v < 0 || u + v > 1) continue;
    const distance = (vx * qx + vy * qy + vz * qz) / volume;
    if (distance > 0 && distance < nearest) {
      found = i / 9;
      nearest = distance;
    }
  }
  return found;
}
