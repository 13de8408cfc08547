// What a view draws, and what it finds under the pointer.

import type { Vector3 } from "three";

/** Triangles of a mesh in upload order: nine numbers each, about `centre`. */
export interface Triangles {
  positions: Float32Array;
  centre: Vector3;
  /** The face of each triangle; null where every face is a triangle. */
  faces: Uint32Array | null;
  /** The vertex of each corner; null where that is not known. */
  corners: Uint32Array | null;
}

/** Labels of faces, and four bytes of colour a cluster. */
export interface Shown {
  labels: Uint32Array;
  colours: Uint8Array;
}

/** What is under a place of the canvas, in its pixels; `pane` is 1 for the second labels. */
export interface Place {
  triangle: number | null;
  pane: number;
  x: number;
  y: number;
}
