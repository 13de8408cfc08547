// What the colours of clusters stand for, other than hues.

import * as address from "./address";
import { ofNumbers } from "./palette";
import { type Shape, ofTypes } from "./shapes";
import type { ClusterRow, Coloured } from "./shown";

/** Four bytes a cluster; null for hues, and undefined where the labels have changed while rows were fetched. */
export async function coloursOf(
  mine: Coloured,
  shapes: Shape[],
  fetchRows: () => Promise<ClusterRow[]>,
): Promise<Uint8Array | null | undefined> {
  const { colours } = address.read();
  if (colours === null) return null;
  if (colours === "shape") return ofTypes(shapes);
  if (colours === "area") {
    mine.measure();
    return ofNumbers(mine.clusters.area);
  }
  const rows = await fetchRows();
  if (rows.length !== mine.hues.length) return undefined;
  return ofNumbers(Float64Array.from(rows, (row) => row[colours] ?? NaN));
}
