// What draws into a canvas of its own. Without alpha, the browser draws nothing below it. Pixels are kept, so that a
// frame with other labels draws no more than the mesh.

import { type Color, WebGLRenderer } from "three";

export function makeRenderer(ratio: number): WebGLRenderer {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("webgl2", {
    alpha: false,
    antialias: false,
    depth: false,
    preserveDrawingBuffer: true,
    powerPreference: "high-performance",
  }) as WebGL2RenderingContext;
  const renderer = new WebGLRenderer({ canvas, context });
  renderer.setPixelRatio(ratio);
  renderer.setScissorTest(true);
  renderer.autoClear = false;
  return renderer;
}

/** Fills the canvas with a colour, which is seen between panes. */
export function fill(renderer: WebGLRenderer, colour: Color): void {
  renderer.setScissorTest(false);
  // three.js makes it one of sRGB
  renderer.setClearColor(colour.clone().convertSRGBToLinear());
  renderer.clear();
  renderer.setScissorTest(true);
  // other targets are cleared to no triangle
  renderer.setClearColor(0);
}
