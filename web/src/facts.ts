// The numbers of a result in words.

import { type Job, type Report, isHierarchical } from "./api";
import { count, digits, duration, make } from "./dom";
import { WORDS, kindOf } from "./kinds";
import { warned } from "./words";

/** Part of the energy at the start by which it is lower at least, to be worth a line. */
const LEAST_FALL = 1e-4;

/**
 * How compact clusters are, as a part of a honeycomb. Null above 1: clusters of parts that lie apart, or as large as
 * their parts, have less energy than any tiling of one plane, and the comparison says nothing.
 */
export function compactness({ energy }: Report): number | null {
  const { hexagon_ratio: ratio } = energy;
  return ratio != null && ratio <= 1 ? ratio : null;
}

export class Facts {
  readonly element = make("section", { "aria-label": "Result" });
  private readonly list = make("dl", { id: "energies", class: "facts" });
  private readonly energy = make("dd", { id: "cut-energy" });

  constructor(job: Job, report: Report) {
    const { initial, final, explained } = report.energy;
    const { faces, items, masked, dimensions, graph } = report.input;
    const isFlat = !isHierarchical(job.parameters.algorithm);
    const kind = kindOf(job);
    const { items: noun, clusters } = WORDS[kind];
    this.row(titled(noun), count(items ?? faces));
    if (masked) this.row("Left out", count(masked));
    if (kind === "points" && dimensions !== undefined) this.row("Columns", count(dimensions));
    if (kind === "points" && graph !== undefined) this.row("Neighbours", graph);
    if (kind !== "mesh" && isFlat && report.clusters !== null) this.row(titled(clusters), count(report.clusters));
    const part = compactness(report);
    if (isFlat && part !== null) this.row("Compactness", `${Math.round(100 * part)} % of a honeycomb`);
    this.list.append(make("div", {}, make("dt", {}, "Energy"), this.energy));
    if (isFlat && final != null) this.tell(final);
    if (isFlat && explained != null) this.row("Explained", `${digits(100 * explained, 4)} %`);
    if (isFlat && initial && final != null && final < (1 - LEAST_FALL) * initial)
      this.row("Since the start", `${digits(100 * (1 - final / initial), 2)} % lower`);
    this.row("Clustered in", duration(report.timings_ms["cluster"] ?? 0));
    this.element.append(this.list);
    for (const warning of report.warnings) this.element.append(make("p", { class: "warning" }, warned(warning)));
  }

  tell(energy: number | null): void {
    this.energy.textContent = energy === null ? "not known" : digits(energy);
  }

  private row(name: string, value: string): void {
    this.list.append(make("div", {}, make("dt", {}, name), make("dd", {}, value)));
  }
}

const titled = (word: string): string => word.charAt(0).toUpperCase() + word.slice(1);
