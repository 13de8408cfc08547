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

  constructor(
    readonly size: Size,
    readonly labels: Uint32Array,
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
    this.hues = new OfPixels(size.width).hues(labels, clusters);
  }

  get clusters(): number {
    return this.items.length;
  }

  get shown(): Shown {
    return { labels: this.labels, colours: ofHues(this.hues) };
  }

  hue(cluster: number): string {
    return css(HUES[this.hues[cluster] ?? 0] ?? [0, 0, 0]);
  }
}
