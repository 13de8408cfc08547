// Which corners of triangles are one vertex: those at one place. A file as it was dropped does not say it.

/** The vertex of each corner, of three numbers a corner. */
export function weld(positions: Float32Array): Uint32Array {
  const bits = new Uint32Array(positions.buffer, positions.byteOffset, positions.length);
  const vertices = new Uint32Array(positions.length / 3);
  let slots = 4;
  while (slots < 2 * vertices.length) slots *= 2;
  // corners by the hash of their place, and one more than the corner, as 0 is none
  const table = new Uint32Array(slots);
  let count = 0;
  for (let corner = 0; corner < vertices.length; corner++) {
    const at = 3 * corner;
    const [x, y, z] = [bits[at] ?? 0, bits[at + 1] ?? 0, bits[at + 2] ?? 0];
    let hash = Math.imul(Math.imul(Math.imul(x, 0x9e3779b1) ^ y, 0x85ebca6b) ^ z, 0xc2b2ae35);
    hash ^= hash >>> 15;
    for (let slot = hash & (slots - 1); ; slot = (slot + 1) & (slots - 1)) {
      const other = (table[slot] ?? 0) - 1;
      if (other < 0) {
        table[slot] = corner + 1;
        vertices[corner] = count++;
        break;
      }
      if (bits[3 * other] === x && bits[3 * other + 1] === y && bits[3 * other + 2] === z) {
        vertices[corner] = vertices[other] ?? 0;
        break;
      }
    }
  }
  return vertices;
}
