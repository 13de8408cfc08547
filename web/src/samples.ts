// Meshes made in place, as OBJ files, so that an empty service has something to show.

import {
  BoxGeometry,
  type BufferGeometry,
  PlaneGeometry,
  SphereGeometry,
  TorusGeometry,
  TorusKnotGeometry,
} from "three";

/** Decimals of a position. Few enough that both sides of a seam are written alike, and so are one vertex. */
const DECIMALS = 5;

const shapes: Record<string, () => BufferGeometry[]> = {
  knot: () => [new TorusKnotGeometry(1, 0.34, 400, 40)],
  terrain: () => [terrain()],
  parts: () => [
    new SphereGeometry(0.8, 96, 64).translate(-2, 0, 0),
    new BoxGeometry(1.2, 1.2, 1.2, 40, 40, 40),
    new TorusGeometry(0.6, 0.28, 64, 128).translate(2, 0, 0),
  ],
};

export function sample(name: string): File {
  const geometries = shapes[name]?.() ?? [];
  return new File([obj(geometries)], `${name}.obj`, { type: "model/obj" });
}

/** Hills of several widths over a square. */
function terrain(): BufferGeometry {
  const plane = new PlaneGeometry(4, 4, 140, 140);
  const positions = plane.getAttribute("position");
  for (let i = 0; i < positions.count; i++) {
    const [x, y] = [positions.getX(i), positions.getY(i)];
    let height = 0;
    for (let octave = 0, scale = 1; octave < 5; octave++, scale *= 2) {
      height += (Math.sin(1.7 * scale * x + octave) * Math.cos(1.3 * scale * y - 2 * octave)) / (2.2 * scale);
    }
    positions.setZ(i, height);
  }
  return plane;
}

function obj(geometries: BufferGeometry[]): string {
  const lines: string[] = [];
  let first = 1;
  for (const [part, geometry] of geometries.entries()) {
    const [positions, index] = [geometry.getAttribute("position"), geometry.getIndex()];
    if (!index) continue;
    lines.push(`o part-${part}`);
    for (let i = 0; i < positions.count; i++) {
      // adding 0 makes a negative zero positive, which would be another position
      const at = [positions.getX(i), positions.getY(i), positions.getZ(i)];
      lines.push(`v ${at.map((x) => (Number(x.toFixed(DECIMALS)) + 0).toFixed(DECIMALS)).join(" ")}`);
    }
    const corner = (i: number): number => first + index.getX(i);
    for (let i = 0; i < index.count; i += 3) lines.push(`f ${corner(i)} ${corner(i + 1)} ${corner(i + 2)}`);
    first += positions.count;
  }
  return lines.join("\n") + "\n";
}
