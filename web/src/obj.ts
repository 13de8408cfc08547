// OBJ files as triangles, for the preview: read in pieces, so that the page answers meanwhile and no text of the whole
// file is in memory.

/** Time after which the page gets a turn, in milliseconds. */
const TURN = 30;

/** Nine numbers a triangle; polygons become fans. More than `most` triangles are an error. */
export async function obj(file: File, most: number): Promise<Float32Array> {
  const places: number[] = [];
  const corners: number[] = [];
  const take = (line: string): void => {
    const [kind, ...words] = line.trim().split(/\s+/);
    if (kind === "v") places.push(Number(words[0]), Number(words[1]), Number(words[2]));
    if (kind !== "f") return;
    // the position is before the first slash; negative numbers count from the end
    const vertices = words.map((word) => parseInt(word)).map((i) => (i < 0 ? places.length / 3 + i : i - 1));
    for (let i = 2; i < vertices.length; i++) corners.push(vertices[0] ?? 0, vertices[i - 1] ?? 0, vertices[i] ?? 0);
    if (corners.length > 3 * most) throw new RangeError();
  };
  const reader = file.stream().pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  let began = performance.now();
  for (;;) {
    const { done, value } = await reader.read();
    const lines = (rest + (value ?? "\n")).split("\n");
    rest = lines.pop() ?? "";
    lines.forEach(take);
    if (done) break;
    if (performance.now() - began < TURN) continue;
    await new Promise((resolve) => setTimeout(resolve, 0));
    began = performance.now();
  }
  const positions = new Float32Array(3 * corners.length);
  for (let i = 0; i < corners.length; i++) {
    const from = 3 * (corners[i] ?? 0);
    for (let axis = 0; axis < 3; axis++) positions[3 * i + axis] = places[from + axis] ?? 0;
  }
  return positions;
}
