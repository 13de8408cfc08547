// Colours of clusters: eight hues of near-equal lightness and chroma (OKLCH). The scale is for numbers of clusters, and
// rises in lightness. The hues are those of files (src/export/colour.rs).

type Colour = readonly [number, number, number];

export const HUES: readonly Colour[] = [
  [241, 138, 142],
  [97, 185, 222],
  [222, 199, 112],
  [207, 142, 211],
  [150, 204, 131],
  [136, 153, 230],
  [240, 166, 108],
  [100, 195, 178],
];

/** Knots of a scale from low to high: lightness rises evenly, so that it reads in grey too. */
const SCALE: readonly Colour[] = [
  [62, 60, 122],
  [46, 108, 148],
  [52, 153, 148],
  [126, 190, 121],
  [246, 216, 110],
];

export const NO_CLUSTER: Colour = [168, 166, 162];

/** A colour of the scale, at 0 to 1. */
export function scale(place: number): Colour {
  const at = Math.min(Math.max(place, 0), 1) * (SCALE.length - 1);
  const [low, high] = [SCALE[Math.floor(at)] ?? NO_CLUSTER, SCALE[Math.ceil(at)] ?? NO_CLUSTER];
  const mix = (channel: 0 | 1 | 2): number => Math.round(low[channel] + (at % 1) * (high[channel] - low[channel]));
  return [mix(0), mix(1), mix(2)];
}

export const css = (colour: Colour | Uint8Array): string => `rgb(${colour.join(" ")})`;

/** Four bytes a cluster, of its hue. */
export function ofHues(hues: Uint8Array): Uint8Array {
  const colours = new Uint8Array(4 * hues.length);
  for (const [cluster, hue] of hues.entries()) colours.set(HUES[hue] ?? NO_CLUSTER, 4 * cluster);
  return colours;
}

/** What clusters are coloured by: four bytes a cluster, and the least, the middle and the most of the numbers. */
export interface Scaled {
  bytes: Uint8Array;
  ends: number[];
}

/** By the ranks of numbers, so that a few extremes do not take the whole scale; gray where a number is not known. */
export function ofNumbers(numbers: Float64Array): Scaled {
  const known = numbers.filter(Number.isFinite).sort();
  const colours = new Uint8Array(4 * numbers.length);
  for (const [cluster, number] of numbers.entries()) {
    let [low, high] = [0, known.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if ((known[middle] ?? 0) < number) low = middle + 1;
      else high = middle;
    }
    const place = known.length > 1 ? low / (known.length - 1) : 0.5;
    colours.set(Number.isFinite(number) ? scale(place) : NO_CLUSTER, 4 * cluster);
  }
  return { bytes: colours, ends: [0, known.length >> 1, known.length - 1].flatMap((rank) => known[rank] ?? []) };
}
