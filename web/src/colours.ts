// What the colours of clusters stand for, other than hues.

import * as address from "./address";
import { type Scaled, ofNumbers } from "./palette";
import type { Shape } from "./api";
import { ofTypes } from "./shapes";
import type { ClusterRow, Coloured } from "./shown";

/** Null for hues, and undefined where the labels or the choice of colours changed while rows were fetched. */
export async function coloursOf(
  mine: Coloured,
  shapes: Shape[],
  fetchRows: () => Promise<ClusterRow[]>,
): Promise<Scaled | null | undefined> {
  const { colours } = address.read();
  if (colours === null) return null;
  if (colours === "shape") return { bytes: ofTypes(shapes), ends: [] };
  if (colours === "area") {
    mine.measure();
    return ofNumbers(mine.clusters.area);
  }
  const rows = await fetchRows();
  if (rows.length !== mine.hues.length || address.read().colours !== colours) return undefined;
  return ofNumbers(Float64Array.from(rows, (row) => row[colours] ?? NaN));
}
