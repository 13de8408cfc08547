// What is shown of an image with superpixels: itself with lines around them, their mean colours, their hues.

export const LAYERS = ["photo", "means", "colours"] as const;
export type Layer = (typeof LAYERS)[number];
