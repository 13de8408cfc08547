// One cluster as an OBJ file, made of the triangles that the page has.

import type { Triangles } from "./drawable";

export function part({ positions, centre, faces }: Triangles, labels: Uint32Array, cluster: number): Blob {
  const vertices = new Map<string, number>();
  const lines: string[] = [];
  const corners: string[] = [];
  const offset = centre?.toArray() ?? [0, 0, 0];
  for (let triangle = 0; triangle < positions.length / 9; triangle++) {
    if (labels[faces ? (faces[triangle] ?? 0) : triangle] !== cluster) continue;
    const three: number[] = [];
    for (let corner = 0; corner < 3; corner++) {
      const from = 9 * triangle + 3 * corner;
      const place = offset.map((at, axis) => at + (positions[from + axis] ?? 0)).join(" ");
      let vertex = vertices.get(place);
      if (vertex === undefined) {
        vertex = vertices.size + 1;
        vertices.set(place, vertex);
        lines.push(`v ${place}`);
      }
      three.push(vertex);
    }
    corners.push(`f ${three.join(" ")}`);
  }
  return new Blob([[`g cluster-${cluster}`, ...lines, ...corners, ""].join("\n")], { type: "model/obj" });
}
