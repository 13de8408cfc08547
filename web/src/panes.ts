// Where sets of labels are in the canvas: one, two beside each other or one above the other, or two parted by a line.

/** How two sets of labels are shown: beside each other, or parted at a part of the width. */
export type Parting = "beside" | number;

export interface Rectangle {
  x: number;
  y: number;
  width: number;
  height: number;
  /** Pixels at the left that belong to the other pane. */
  cut: number;
}

/** Pixels between two panes. */
const GAP = 2;

/** A pane in pixels of the canvas, from the lower left; `isAbove`: the first of two is above the other. */
export function place(
  pane: number,
  panes: number,
  parting: Parting,
  { x: width, y: height }: { x: number; y: number },
  isAbove: boolean,
): Rectangle {
  if (panes === 1) return { x: 0, y: 0, width, height, cut: 0 };
  if (parting !== "beside") return { x: 0, y: 0, width, height, cut: pane * Math.round(width * parting) };
  const half = (length: number): number => Math.floor((length - GAP) / 2);
  if (!isAbove) return { x: pane * (width - half(width)), y: 0, width: half(width), height, cut: 0 };
  return { x: 0, y: (1 - pane) * (height - half(height)), width, height: half(height), cut: 0 };
}

export const isIn = ({ x, y, width, height, cut }: Rectangle, right: number, up: number): boolean =>
  right >= x + cut && right < x + width && up >= y && up < y + height;
