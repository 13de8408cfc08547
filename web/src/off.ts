// OFF files as triangles, for the preview.

/** Nine numbers a triangle; polygons become fans. More than `most` triangles are an error. */
export function off(text: string, most: number): Float32Array {
  const lines = text
    .replace(/#.*/g, "")
    .split("\n")
    .filter((line) => line.trim() !== "");
  const words = (line: string | undefined): number[] => (line ?? "").trim().split(/\s+/).map(Number);
  // the counts may follow the keyword in its line
  const keyword = (lines.shift() ?? "").replace(/^\s*\S*OFF/, "");
  if (keyword.trim() !== "") lines.unshift(keyword);
  const [vertices = 0, faces = 0] = words(lines[0]);
  const places = lines.slice(1, 1 + vertices).map(words);
  const positions: number[] = [];
  for (const line of lines.slice(1 + vertices, 1 + vertices + faces)) {
    const [corners = 0, ...face] = words(line);
    for (let i = 2; i < corners; i++)
      for (const corner of [0, i - 1, i])
        for (const axis of [0, 1, 2]) positions.push(places[face[corner] ?? 0]?.[axis] ?? 0);
    if (positions.length > 9 * most) throw new RangeError();
  }
  return new Float32Array(positions);
}
