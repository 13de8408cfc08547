// Another job of the same mesh: the choice of it, its labels in place of this job's or beside them, and both energies.

import * as address from "./address";
import { type Job, type Labels, type Report, isHierarchical, json, labels, nameOf, output } from "./api";
import { count, digits, make } from "./dom";

export class Comparison {
  readonly element = make("div", { class: "tools" });
  /** Which job is on which side of the view. */
  readonly captions = make("div", { class: "captions", hidden: true });
  /** Called when another job, or none, is chosen. */
  onChoose: () => void = () => {};
  /** Called when the labels are to be beside this job's, or in their place. */
  onArrange: () => void = () => {};
  /** The labels of the other job. */
  labels: Labels | null = null;
  private other: string | null;
  private jobs: Job[] = [];
  private readonly told = make("span", { id: "compared" });
  private readonly choice = make("select", {
    id: "other",
    onchange: () => {
      this.other = this.choice.value === "" ? null : this.choice.value;
      address.amend({ with: this.other });
      this.onChoose();
    },
  });
  private readonly side = make("input", {
    id: "beside",
    type: "checkbox",
    onchange: () => {
      address.amend({ beside: this.side.checked });
      this.onArrange();
    },
  });

  constructor(private readonly job: Job) {
    const { with: other, beside } = address.read();
    this.other = other;
    this.side.checked = beside;
  }

  /** Whether the labels of the other job are beside this job's. */
  get isBeside(): boolean {
    return this.labels !== null && this.side.checked && this.job.keep_mesh;
  }

  /** Whether the labels of the other job are in place of this job's. */
  get isReplaced(): boolean {
    return this.labels !== null && !this.isBeside;
  }

  /** Finds the jobs of equally many faces from a file of the same name, and offers them. */
  async offer(signal: AbortSignal): Promise<void> {
    const { jobs } = await json<{ jobs: Job[] }>("/v1/jobs?state=succeeded&limit=200", { signal });
    const { job } = this;
    this.jobs = jobs.filter(
      (other) => other.id !== job.id && other.result?.faces === job.result?.faces && nameOf(other) === nameOf(job),
    );
    if (this.jobs.length === 0) return;
    this.choice.replaceChildren(make("option", { value: "" }, "no other job"));
    for (const other of this.jobs) this.choice.append(make("option", { value: other.id }, brief(other)));
    const label = make("label", { for: "other" }, "Compare with");
    const side = make("label", { for: "beside" }, this.side, " beside each other");
    this.element.replaceChildren(label, this.choice, side, this.told);
  }

  /** Fetches the labels of the job that is chosen, with their energy. A hierarchy is cut at `clusters`. */
  async fetch(clusters: number | null, signal: AbortSignal): Promise<void> {
    const job = this.jobs.find(({ id }) => id === this.other);
    this.choice.value = job?.id ?? "";
    if (!job) {
      this.labels = null;
      return;
    }
    const cut = isHierarchical(job.parameters.algorithm) ? (clusters ?? this.job.result?.clusters ?? null) : null;
    const shown = await labels(job, cut, signal);
    const energy = shown.energy ?? (await energyOf(job, signal));
    this.labels = { ...shown, energy };
    this.captions.replaceChildren(make("span", {}, `this job: ${brief(this.job)}`), make("span", {}, brief(job)));
  }

  /** Says both energies. */
  tell(mine: number | null): void {
    this.side.disabled = this.labels === null || !this.job.keep_mesh;
    this.captions.hidden = !this.isBeside;
    const other = this.labels?.energy ?? null;
    const change = mine && other ? ` (${other < mine ? "−" : "+"}${digits(Math.abs(100 * (other / mine - 1)))} %)` : "";
    const own = mine === null ? "" : `this job's energy: ${digits(mine)}, `;
    this.told.textContent = other === null ? "" : `${own}its energy: ${digits(other)}${change}`;
  }
}

const brief = ({ id, parameters: p }: Job): string =>
  `${p.algorithm}, ${p.clusters ?? "all"}, ${p.quality ?? "default"} (${id.slice(0, 8)})`;

/** The energy of the labels of a flat job. */
async function energyOf(job: Job, signal: AbortSignal): Promise<number | null> {
  return (await json<Report>(output(job, "report"), { signal })).energy.final;
}

/** The cluster of other labels that has most faces in common with a cluster; of equal ones that with the first face. */
export function counterpart(labels: Uint32Array, others: Uint32Array, cluster: number): number | null {
  const common = new Map<number, number>();
  let [best, most]: [number | null, number] = [null, 0];
  for (let face = 0; face < labels.length; face++) {
    if (labels[face] === cluster) common.set(others[face] ?? 0, (common.get(others[face] ?? 0) ?? 0) + 1);
  }
  for (const [other, faces] of common) if (faces > most) [best, most] = [other, faces];
  return best;
}

/** What two clusters of different labels have in common. */
export function overlap(labels: Uint32Array, cluster: number, others: Uint32Array, other: number): string {
  let [faces, common] = [0, 0];
  for (let face = 0; face < others.length; face++) {
    if (others[face] !== other) continue;
    faces += 1;
    if (labels[face] === cluster) common += 1;
  }
  return `beside it cluster ${other}: ${count(faces)} faces, ${count(common)} in common`;
}
