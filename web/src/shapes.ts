// The shapes of clusters, of jobs with an energy of shapes: what is said of them, and a colour a type.

import type { Job, Shape } from "./api";
import { count, digits } from "./dom";
import { HUES, NO_CLUSTER, css } from "./palette";

/** Each type with its hue. */
const TYPES: Record<string, (typeof HUES)[number] | undefined> = {
  plane: HUES[5],
  sphere: HUES[6],
  cylinder: HUES[4],
  cone: HUES[3],
};

/** Parameters that have other names here, or are written in another way. Other numbers are written as they are. */
const PARAMETERS: Record<string, (value: never) => [string, string]> = {
  convex: (isConvex: boolean) => ["Side", isConvex ? "outside" : "inside"],
  extent: ([low, high]: [number, number]) => ["Length", digits(high - low)],
  angle: (degrees: number) => ["Arc", `${digits(degrees, 3)}°`],
  half_angle: (degrees: number) => ["Half angle", `${digits(degrees, 3)}°`],
};

export const hasShapes = (job: Job): boolean => ["planes", "shapes"].includes(String(job.parameters["energy"]));

/** The angle of edges that are sharp where the job names none, in degrees. */
const SHARP = 40;

/** Faces above which sharp edges are not looked for, which takes a second there. */
const MOST_FACES = 200_000;

/** The angle in degrees of the edges that say something of clusters; null where there are none or too many faces. */
export function angleOf(job: Job): number | null {
  if ((job.result?.faces ?? 0) > MOST_FACES) return null;
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
  const types = new Set([...Object.keys(TYPES), ...shapes.map(({ type }) => type)]);
  return [...types].flatMap((type): [string, string][] => {
    const number = shapes.filter((shape) => shape.type === type).length;
    if (number === 0) return [];
    return [[css(TYPES[type] ?? NO_CLUSTER), `${count(number)} ${type}${number === 1 ? "" : "s"}`]];
  });
}

const parametersOf = (shape: Shape): Record<string, unknown> => (shape[shape.type] ?? {}) as Record<string, unknown>;

const titled = (word: string): string => (word.charAt(0).toUpperCase() + word.slice(1)).replaceAll("_", " ");

/** "Cylinder, radius 0.6". */
export function titleOf(shape: Shape): string {
  const { radius } = parametersOf(shape);
  return typeof radius === "number" ? `${titled(shape.type)}, radius ${digits(radius)}` : titled(shape.type);
}

export function factsOfShape(shape: Shape): [string, string][] {
  const facts: [string, string][] = [["Shape", titleOf(shape)]];
  for (const [name, value] of Object.entries(parametersOf(shape))) {
    const write = PARAMETERS[name];
    if (write) facts.push(write(value as never));
    else if (typeof value === "number" && name !== "radius") facts.push([titled(name), digits(value)]);
  }
  const { torus } = shape;
  if (torus) {
    const { major_radius: major, minor_radius: minor } = torus;
    facts.push(["Slice of a torus", `radii ${digits(major)} and ${digits(minor)}`]);
  }
  const { rms, max } = shape.residual;
  facts.push(["Residual", `${digits(rms, 2)}, at most ${digits(max, 2)}`]);
  return facts;
}
