// The numbers of a result in words.

import { type Job, type Report, isHierarchical } from "./api";
import { count, digits, duration, make } from "./dom";

/** A job in a line: "400 clusters of 69,451 faces · 0.39 s". */
export function brief(job: Job, clusters: number | null = null): string {
  const { result, started_at: started, ended_at: ended } = job;
  if (!result) return "";
  const took = started && ended ? ` · ${duration(Date.parse(ended) - Date.parse(started))}` : "";
  const shown = clusters ?? result.clusters;
  const many = shown === 1 ? "1 cluster" : `${count(shown)} clusters`;
  if (isHierarchical(job.parameters.algorithm) && clusters === null)
    return `any number of clusters of ${count(result.faces)} faces${took}`;
  return `${many} of ${count(result.faces)} faces${took}`;
}

/** How a job was made: "given number · best". */
export function manner({ parameters: { algorithm, quality } }: Job): string {
  const names: Record<string, string> = {
    bb: "Given number",
    pml: "Any number",
    ml: "Any number, ML",
    hr: "Any number, HR",
    acvd: "Given number, ACVD",
    vc: "Given number, VC",
  };
  return `${names[algorithm] ?? algorithm}${quality && quality !== "default" ? ` · ${quality}` : ""}`;
}

export class Facts {
  readonly element = make("section", { "aria-label": "Result" });
  private readonly list = make("dl", { id: "energies", class: "facts" });
  private readonly energy = make("dd", { id: "cut-energy" });

  constructor(job: Job, report: Report) {
    const { initial, final, hexagon_ratio: ratio } = report.energy;
    const isFlat = !isHierarchical(job.parameters.algorithm);
    this.row("Faces", count(report.input.faces));
    if (isFlat && ratio != null) this.row("Compactness", `${Math.round(100 * ratio)} % of a honeycomb`);
    this.list.append(make("div", {}, make("dt", {}, "Energy"), this.energy));
    if (isFlat && final != null) this.tell(final);
    if (isFlat && initial && final != null && final < initial)
      this.row("Since the start", `${digits(100 * (1 - final / initial), 2)} % lower`);
    this.row("Clustered in", duration(report.timings_ms["cluster"] ?? 0));
    this.element.append(this.list);
    for (const warning of report.warnings) this.element.append(make("p", { class: "warning" }, warning));
  }

  tell(energy: number | null): void {
    this.energy.textContent = energy === null ? "not known" : digits(energy);
  }

  private row(name: string, value: string): void {
    this.list.append(make("div", {}, make("dt", {}, name), make("dd", {}, value)));
  }
}
