// What lies over an image: lines between superpixels, their colours, and the one that is selected or under the pointer.
// It is made of the labels that the pixels of the canvas show, so its time does not depend on the image, and lines have
// one width at every zoom.

import type { Shown } from "./drawable";
import type { Layer } from "./layers";
import { FREE } from "./pixels";
import type { Size } from "./photo";

/** Where the image is: pixels of the canvas along one of the image, and its upper left corner. */
export interface Place {
  scale: number;
  x: number;
  y: number;
}

/** Colours as bytes, from the highest: alpha, blue, green, red. */
const [LIGHT, DARK, HOVERED, LINE] = [0xf2ffffff, 0x80000000, 0x48ffffff, 0x8c000000];
const NOTHING = 0;

/** Parts of the pixels of a superpixel that are lines, between which lines become faint, and how faint. */
const [FEW, MANY, FAINT] = [0.12, 0.45, 0.3];

export class Overlay {
  selected: number | null = null;
  hovered: number | null = null;
  private readonly canvas = document.createElement("canvas");
  private grid = new Uint32Array();

  /** Draws over the part of the image that the canvas shows. `faded` has the bytes of what covers the others. */
  draw(to: CanvasRenderingContext2D, size: Size, place: Place, shown: Shown, layer: Layer, faded: number): void {
    const { scale } = place;
    const left = Math.max(0, Math.round(place.x));
    const top = Math.max(0, Math.round(place.y));
    const width = Math.min(to.canvas.width, Math.round(place.x + scale * size.width)) - left;
    const height = Math.min(to.canvas.height, Math.round(place.y + scale * size.height)) - top;
    if (width <= 0 || height <= 0) return;
    const at = (pixel: number, from: number, most: number): number =>
      Math.min(most - 1, Math.max(0, Math.floor((pixel + 0.5 - from) / scale)));
    const columns = Uint32Array.from({ length: width }, (_, x) => at(left + x, place.x, size.width));
    if (this.grid.length !== width * height) this.grid = new Uint32Array(width * height);
    for (let y = 0, i = 0; y < height; y++) {
      const row = at(top + y, place.y, size.height) * size.width;
      for (let x = 0; x < width; x++) this.grid[i++] = shown.labels[row + (columns[x] ?? 0)] ?? FREE;
    }
    const image = new ImageData(width, height);
    this.paint(new Uint32Array(image.data.buffer), width, height, shown.colours, layer, faded);
    // an image that is put, and not drawn, would replace what is below
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    this.canvas.getContext("2d")?.putImageData(image, 0, 0);
    to.drawImage(this.canvas, left, top);
  }

  /** How strong the lines of each superpixel are: ragged ones would cover the image. */
  private strengths(width: number, pace: number, clusters: number): Float32Array {
    const { grid } = this;
    const [all, lines] = [new Uint32Array(clusters), new Uint32Array(clusters)];
    for (let i = 0; i < grid.length; i++) {
      const label = grid[i] ?? FREE;
      if (label === FREE) continue;
      all[label] = (all[label] ?? 0) + 1;
      if (grid[i + pace] !== label || grid[i + pace * width] !== label) lines[label] = (lines[label] ?? 0) + 1;
    }
    return Float32Array.from(all, (pixels, label) => {
      const part = ((lines[label] ?? 0) / pixels - FEW) / (MANY - FEW);
      return 1 - (1 - FAINT) * Math.min(1, Math.max(0, part));
    });
  }

  private paint(
    out: Uint32Array,
    width: number,
    height: number,
    colours: Uint8Array,
    layer: Layer,
    faded: number,
  ): void {
    const { grid } = this;
    const colour = new Uint32Array(colours.buffer, colours.byteOffset, colours.length / 4);
    const [selected, hovered] = [this.selected ?? FREE, this.hovered ?? FREE];
    const pace = Math.max(1, Math.round(devicePixelRatio));
    const down = pace * width;
    const strength = layer === "photo" ? this.strengths(width, pace, colour.length) : null;
    for (let y = 0, i = 0; y < height; y++) {
      const [isFirst, isLast] = [y < pace, y >= height - pace];
      for (let x = 0; x < width; x++, i++) {
        const label = grid[i] ?? FREE;
        const right = x < width - pace ? grid[i + pace] : label;
        const below = isLast ? label : grid[i + down];
        const left = x >= pace ? grid[i - pace] : label;
        const above = isFirst ? label : grid[i - down];
        let pixel = NOTHING;
        if (layer !== "photo" && label !== FREE) pixel = (0xff000000 | (colour[label] ?? 0)) >>> 0;
        if (selected !== FREE && label !== selected && label !== hovered) pixel = mix(pixel, faded);
        if (label !== FREE && label === hovered && selected === FREE) pixel = mix(pixel, HOVERED);
        const isBorder = right !== label || below !== label;
        // without the corner, a line that falls to the right at 45 degrees has none
        const corner = isFirst || x >= width - pace ? label : grid[i - down + pace];
        const isBeside = left !== label || above !== label || corner !== label;
        if (layer === "photo") {
          if (isBorder) pixel = mix(pixel, weaker(selected === FREE ? LIGHT : LINE, strength?.[label] ?? 1));
          else if (isBeside && selected === FREE) pixel = mix(pixel, weaker(DARK, strength?.[label] ?? 1));
        } else if (layer === "colours" && isBorder) pixel = mix(pixel, LINE);
        if (selected !== FREE && (isBorder || isBeside)) {
          // inside light, outside dark, so that it is seen on every colour
          if (label === selected) pixel = LIGHT;
          else if ([right, below, left, above].includes(selected)) pixel = mix(pixel, DARK);
        }
        out[i] = pixel;
      }
    }
  }
}

/** A colour with a part of its alpha. */
const weaker = (colour: number, part: number): number =>
  ((Math.round((colour >>> 24) * part) << 24) | (colour & 0xffffff)) >>> 0;

/** One colour with another one over it. */
function mix(under: number, over: number): number {
  const [alpha, below] = [over >>> 24, under >>> 24];
  if (below === 0) return over;
  const rest = (below * (255 - alpha)) / 255;
  const all = alpha + rest;
  const channel = (shift: number): number =>
    Math.round((((over >>> shift) & 255) * alpha + ((under >>> shift) & 255) * rest) / all) << shift;
  return ((Math.round(all) << 24) | channel(16) | channel(8) | channel(0)) >>> 0;
}
