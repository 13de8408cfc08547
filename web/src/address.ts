// The address: `#/jobs/ID?clusters=K&cluster=C&with=OTHER&parting=wipe&line=0.5&up=z&over=edges&colours=area`, of an
// image `?cluster=C&layer=means`, of the first visit `#/?clusters=K`. A reload, a bookmark and a link show the same.

import { LAYERS, type Layer } from "./layers";

export const COLOURS = ["area", "roundness", "energy", "shape"] as const;

export const OVERLAYS = ["remesh", "edges"] as const;
export type Overlay = (typeof OVERLAYS)[number];

export interface Address {
  job: string | null;
  clusters: number | null;
  cluster: number | null;
  /** The job that is compared. */
  with: string | null;
  /** How the two are shown; beside each other where it is null. */
  parting: "wipe" | null;
  /** Where the line of a wipe is, as a part of the width. */
  line: number | null;
  /** Which way is up; as guessed where it is null. */
  up: "y" | "z" | null;
  /** What is shown of an image; the first that there is where it is null. */
  layer: Layer | null;
  /** What is drawn over the mesh. */
  over: Overlay | null;
  /** What colours stand for; for clusters where it is null. */
  colours: (typeof COLOURS)[number] | null;
}

export function read(): Address {
  const [path = "", query = ""] = location.hash.slice(1).split("?");
  const search = new URLSearchParams(query);
  const number = (name: string): number | null =>
    /^\d{1,10}$/.test(search.get(name) ?? "") ? Number(search.get(name)) : null;
  const one = <T extends string>(name: string, of: readonly T[]): T | null =>
    of.find((value) => value === search.get(name)) ?? null;
  const other = search.get("with");
  return {
    job: /^\/jobs\/([0-9a-f-]+)$/.exec(path)?.[1] ?? null,
    clusters: number("clusters"),
    cluster: number("cluster"),
    with: /^[0-9a-f-]+$/.test(other ?? "") ? other : null,
    parting: one("parting", ["wipe"]),
    line: /^(0(\.\d{1,3})?|1)$/.test(search.get("line") ?? "") ? Number(search.get("line")) : null,
    up: one("up", ["y", "z"]),
    layer: one("layer", LAYERS),
    over: one("over", OVERLAYS),
    colours: one("colours", COLOURS),
  };
}

export const ofJob = (id: string): string => `#/jobs/${id}`;

/** The address that the page shows. */
let shown = "";

/** Says that the page shows the address from now on. */
export function arrive(): void {
  shown = location.hash;
}

/**
 * Changes parts of the address without a step back in the history; not of one that was entered just now, to which the
 * page changes next.
 */
export function amend(change: Partial<Address>): void {
  if (location.hash !== shown) return;
  const { job, ...rest } = { ...read(), ...change };
  const given = Object.entries(rest).filter(([, value]) => value !== null);
  const search = new URLSearchParams(given.map(([key, value]) => [key, String(value)]));
  const hash = `${job === null ? "#/" : ofJob(job)}${search.size > 0 ? `?${search}` : ""}`;
  // even the same address would undo one that is just being entered
  if (hash === shown) return;
  history.replaceState(null, "", hash);
  arrive();
}
