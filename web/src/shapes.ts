// The shapes of clusters, of jobs with an energy of shapes: what is said of them, and a colour a type.

import type { Job } from "./api";
import { count, digits } from "./dom";
import { HUES, NO_CLUSTER, css } from "./palette";

/** A row of the report's `shapes`; lengths in units of the file, angles in degrees. */
export interface Shape {
  type: "plane" | "sphere" | "cylinder";
  residual: { rms: number; max: number };
  sphere?: { radius: number; convex: boolean };
  cylinder?: { radius: number; convex: boolean; extent: [number, number]; angle: number };
}

/** Each type with its hue. */
const TYPES = { plane: HUES[5], sphere: HUES[6], cylinder: HUES[4] };

export const hasShapes = (job: Job): boolean => ["planes", "shapes"].includes(String(job.parameters["energy"]));

/** The angle of edges that are sharp where the job names none, in degrees. */
const SHARP = 40;

/** The angle in degrees of the edges that say something of clusters; null where the page can find none. */
export function angleOf(job: Job): number | null {
  const angle = /[\d.]+/.exec(String(job.parameters["features"] ?? ""));
  if (angle) return Number(angle[0]);
  return hasShapes(job) ? SHARP : null;
}

/** Four bytes a cluster, of its type. */
export function ofTypes(shapes: Shape[]): Uint8Array {
  const colours = new Uint8Array(4 * shapes.length);
  for (const [cluster, { type }] of shapes.entries()) colours.set(TYPES[type] ?? NO_CLUSTER, 4 * cluster);
  return colours;
}

/** The types that there are: a colour each, and how many clusters have it. */
export function legend(shapes: Shape[]): [string, string][] {
  const counts = Object.entries(TYPES).map(([type, hue]): [string, string, number] => {
    const number = shapes.filter((shape) => shape.type === type).length;
    return [css(hue ?? NO_CLUSTER), `${type}${number === 1 ? "" : "s"}`, number];
  });
  return counts
    .filter(([, , number]) => number > 0)
    .map(([colour, name, number]) => [colour, `${count(number)} ${name}`]);
}

/** "Cylinder, radius 0.6". */
export function titleOf({ type, sphere, cylinder }: Shape): string {
  const radius = (sphere ?? cylinder)?.radius;
  return `${type.charAt(0).toUpperCase()}${type.slice(1)}${radius === undefined ? "" : `, radius ${digits(radius)}`}`;
}

export function factsOfShape(shape: Shape): [string, string][] {
  const { residual, sphere, cylinder } = shape;
  const facts: [string, string][] = [["Shape", titleOf(shape)]];
  const round = sphere ?? cylinder;
  if (round) facts.push(["Side", round.convex ? "outside" : "inside"]);
  if (cylinder) {
    const [low, high] = cylinder.extent;
    facts.push(["Length", digits(high - low)], ["Arc", `${digits(cylinder.angle, 3)}°`]);
  }
  facts.push(["Residual", `${digits(residual.rms, 2)}, at most ${digits(residual.max, 2)}`]);
  return facts;
}
