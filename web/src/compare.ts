// Another job of the same mesh: the choice of it, its labels in place of this job's, and both energies.

import { type Job, type Labels, type Report, isHierarchical, json, labels, nameOf, output } from "./api";
import { digits, make } from "./dom";

export class Comparison {
  readonly element = make("div", { class: "tools" });
  /** Called when another job, or none, is chosen. */
  onChoose: (other: string | null) => void = () => {};
  private jobs: Job[] = [];
  private readonly told = make("span", { id: "compared" });
  private readonly choice = make("select", {
    id: "other",
    onchange: () => this.onChoose(this.choice.value === "" ? null : this.choice.value),
  });

  constructor(private readonly job: Job) {}

  /** Finds the jobs of equally many faces from a file of the same name, and offers them. */
  async offer(signal: AbortSignal): Promise<void> {
    const { jobs } = await json<{ jobs: Job[] }>("/v1/jobs?state=succeeded&limit=200", { signal });
    const { job } = this;
    this.jobs = jobs.filter(
      (other) => other.id !== job.id && other.result?.faces === job.result?.faces && nameOf(other) === nameOf(job),
    );
    if (this.jobs.length === 0) return;
    this.choice.replaceChildren(make("option", { value: "" }, "this job"));
    for (const { id, parameters: p } of this.jobs) {
      const text = `${p.algorithm}, ${p.clusters ?? "all"}, ${p.quality ?? "default"} (${id.slice(0, 8)})`;
      this.choice.append(make("option", { value: id }, text));
    }
    const label = make("label", { for: "other" }, "Show the labels of");
    this.element.replaceChildren(label, this.choice, this.told);
  }

  /** The labels of a job that was offered, with their energy; null for none. A hierarchy is cut at `clusters`. */
  async show(other: string | null, clusters: number | null, signal: AbortSignal): Promise<Labels | null> {
    const job = this.jobs.find(({ id }) => id === other);
    this.choice.value = job?.id ?? "";
    this.told.textContent = "";
    if (!job) return null;
    const cut = isHierarchical(job.parameters.algorithm) ? (clusters ?? this.job.result?.clusters ?? null) : null;
    const shown = await labels(job, cut, signal);
    const energy = shown.energy ?? (await energyOf(job, signal));
    return { ...shown, energy };
  }

  /** Says both energies. */
  tell(mine: number | null, other: number | null): void {
    if (other === null) return;
    const change = mine ? ` (${other < mine ? "−" : "+"}${digits(Math.abs(100 * (other / mine - 1)))} %)` : "";
    const own = mine === null ? "" : `this job's energy: ${digits(mine)}, `;
    this.told.textContent = `${own}its energy: ${digits(other)}${change}`;
  }
}

/** The energy of the labels of a flat job. */
export async function energyOf(job: Job, signal: AbortSignal): Promise<number | null> {
  return (await json<Report>(output(job, "report"), { signal })).energy.final;
}
