// The labels of an image: how many pixels each superpixel has, and a hue for it that its neighbours have not.

import { Colouring } from "./colouring";
import type { Shown } from "./drawable";
import { HUES, css, ofHues } from "./palette";
import type { Size } from "./photo";

/** The label of a pixel that takes no part. */
export const FREE = 0xffffffff;

/** Superpixels are neighbours where pixels beside each other are. */
class OfPixels extends Colouring {
  constructor(private readonly width: number) {
    super();
  }

  protected override meet(labels: Uint32Array): number {
    const { width } = this;
    let count = 0;
    for (let i = 0; i < labels.length; i++) {
      const label = labels[i] ?? FREE;
      if (label === FREE) continue;
      const right = (i + 1) % width === 0 ? label : (labels[i + 1] ?? FREE);
      const below = labels[i + width] ?? FREE;
      if (right !== label && right !== FREE) count = this.pair(label, right, count);
      if (below !== label && below !== FREE) count = this.pair(label, below, count);
    }
    return count;
  }
}

export class Pixels {
  /** Pixels of each superpixel, and the first one. */
  readonly items: Uint32Array;
  readonly first: Uint32Array;
  private readonly hues: Uint8Array;
  private readonly colouring: Colouring;

  constructor(
    readonly size: Size,
    readonly labels: Uint32Array,
    /** Those at another cut, whose hues go on. */
    before: Pixels | null = null,
  ) {
    let clusters = 0;
    for (const label of labels) if (label !== FREE && label >= clusters) clusters = label + 1;
    this.items = new Uint32Array(clusters);
    this.first = new Uint32Array(clusters);
    for (let i = labels.length - 1; i >= 0; i--) {
      const label = labels[i] ?? FREE;
      if (label === FREE) continue;
      this.items[label] = (this.items[label] ?? 0) + 1;
      this.first[label] = i;
    }
    this.colouring = before?.colouring ?? new OfPixels(size.width);
    this.hues = this.colouring.hues(labels, clusters);
  }

  get clusters(): number {
    return this.items.length;
  }

  get shown(): Shown {
    return { labels: this.labels, colours: ofHues(this.hues) };
  }

  /** Four bytes a superpixel: what an image has at its first pixel, as an image of means has it everywhere. */
  firstOf({ data }: ImageData): Uint8Array {
    return Uint8Array.from({ length: 4 * this.clusters }, (_, i) => data[4 * (this.first[i >> 2] ?? 0) + (i & 3)] ?? 0);
  }

  /** The same of the means of a photo, which the service takes in CIELAB. */
  meansOf({ data }: ImageData): Uint8Array {
    const sums = new Float64Array(4 * this.clusters);
    for (let i = 0; i < this.labels.length; i++) {
      const label = this.labels[i] ?? FREE;
      if (label === FREE) continue;
      for (let c = 0; c < 4; c++) sums[4 * label + c] = (sums[4 * label + c] ?? 0) + (data[4 * i + c] ?? 0);
    }
    return Uint8Array.from(sums, (sum, i) => Math.round(sum / (this.items[i >> 2] || 1)));
  }

  hue(cluster: number): string {
    return css(HUES[this.hues[cluster] ?? 0] ?? [0, 0, 0]);
  }
}
