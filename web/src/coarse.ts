// A mesh of fewer triangles, to be drawn while the camera moves: the vertices in a cell of a grid become the first of
// them, and triangles with two corners in one cell are left out (vertex clustering, Rossignac and Borrel 1993).

/** Cells along the longest side of the mesh. */
const CELLS = 96;

export interface Coarse {
  /** Nine numbers a triangle. */
  positions: Float32Array;
  /** The triangle of the mesh that each was. */
  sources: Uint32Array;
}

export function coarsen(positions: Float32Array): Coarse {
  const [low, high] = [
    [Infinity, Infinity, Infinity],
    [-Infinity, -Infinity, -Infinity],
  ] as [number[], number[]];
  for (let i = 0; i < positions.length; i++) {
    const [axis, place] = [i % 3, positions[i] ?? 0];
    if (place < (low[axis] ?? 0)) low[axis] = place;
    if (place > (high[axis] ?? 0)) high[axis] = place;
  }
  const [x = 0, y = 0, z = 0] = low;
  const longest = Math.max(...high.map((place, axis) => place - (low[axis] ?? 0)));
  const scale = (CELLS - 1) / (longest || 1);
  const cellOf = (i: number): number => {
    const along = (axis: number, from: number): number => (((positions[i + axis] ?? 0) - from) * scale) | 0;
    return along(0, x) + CELLS * (along(1, y) + CELLS * along(2, z));
  };
  // where the vertex that stands for a cell begins in `positions`
  const first = new Int32Array(CELLS ** 3).fill(-1);
  const [corners, sources]: [number[], number[]] = [[], []];
  for (let i = 0; i < positions.length; i += 9) {
    const [a, b, c] = [cellOf(i), cellOf(i + 3), cellOf(i + 6)];
    if (a === b || b === c || c === a) continue;
    if ((first[a] ?? 0) < 0) first[a] = i;
    if ((first[b] ?? 0) < 0) first[b] = i + 3;
    if ((first[c] ?? 0) < 0) first[c] = i + 6;
    corners.push(first[a] ?? 0, first[b] ?? 0, first[c] ?? 0);
    sources.push(i / 9);
  }
  const moved = new Float32Array(3 * corners.length);
  for (const [i, from] of corners.entries()) moved.set(positions.subarray(from, from + 3), 3 * i);
  return { positions: moved, sources: new Uint32Array(sources) };
}
