// Everything that draws, and with it three.js and uPlot: a script of its own, so that the page is there before them.

export { Colouring } from "./colouring";
export { Curve } from "./curve";
export { edges, sharpEdges, triangles } from "./mesh";
export { Plane } from "./plane";
export { preview } from "./preview";
export { sample } from "./samples";
export { View } from "./view";
