// Another job of the same mesh: the choice of it, its labels beside this job's or on the other side of a line that moves,
// and what is to be compared: energies of equally many clusters, or else how compact both are.

import * as address from "./address";
import { type Job, type Labels, type Report, isHierarchical, json, labels, nameOf, output } from "./api";
import { count, digits, make, option } from "./dom";
import { compactness } from "./facts";
import { isDeleted } from "./trash";
import { energyOf, manner } from "./words";

/** What is compared. */
export interface Measured {
  clusters: number;
  energy: number | null;
  /** Energy of a tiling with hexagons over that of the clusters. */
  compactness: number | null;
}

export class Comparison {
  readonly element = make("section", { hidden: true, "aria-labelledby": "compare-title" });
  /** Which job is on which side of the view, and the line between them. */
  readonly captions = make("div", { class: "captions", hidden: true });
  /** Called when another job, or none, is chosen. */
  onChoose: () => void = () => {};
  /** Called when both are to be shown in another way, or the line moves. */
  onArrange: () => void = () => {};
  /** The labels of the other job. */
  labels: Labels | null = null;
  /** Whether only the line moved since the last change. */
  isParted = false;
  private measured: Measured | null = null;
  private jobs: Job[] = [];
  private readonly told = make("p", { id: "compared" });
  private readonly choice = make("select", {
    id: "other",
    onchange: () => {
      address.amend({ with: this.choice.value === "" ? null : this.choice.value });
      this.onChoose();
    },
  });
  private readonly wipe = make("input", {
    id: "wipe",
    type: "checkbox",
    onchange: () => {
      address.amend({ parting: this.wipe.checked ? "wipe" : null });
      this.isParted = false;
      this.onArrange();
    },
  });
  private readonly line = make("input", {
    id: "line",
    type: "range",
    min: "0",
    max: "1",
    step: "0.005",
    value: String(address.read().line ?? 0.5),
    "aria-label": "Line between the two jobs",
    oninput: () => {
      this.isParted = true;
      this.captions.style.setProperty("--part", this.line.value);
      this.onArrange();
    },
    // not at every move, as a browser may refuse many changes of the address
    onchange: () => address.amend({ line: Number(this.line.value) }),
  });

  constructor(private readonly job: Job) {
    this.wipe.checked = address.read().parting === "wipe";
    this.captions.style.setProperty("--part", this.line.value);
    const title = make("h3", { id: "compare-title" }, "Compare");
    const label = make("label", { for: "other", class: "hidden-text" }, "Compare with");
    const wipe = make("label", { for: "wipe", class: "check" }, this.wipe, "with a line to move");
    this.element.append(title, label, this.choice, this.told, wipe);
  }

  get parting(): "beside" | number {
    return this.wipe.checked ? Number(this.line.value) : "beside";
  }

  /** Finds the jobs of equally many faces from a file of the same name, and offers them. */
  async offer(signal: AbortSignal): Promise<void> {
    const { jobs } = await json<{ jobs: Job[] }>("/v1/jobs?state=succeeded&limit=200", { signal });
    const { job } = this;
    const isAlike = (other: Job): boolean =>
      other.result?.faces === job.result?.faces && nameOf(other) === nameOf(job) && !isDeleted(other.id);
    this.jobs = jobs.filter((other) => other.id !== job.id && isAlike(other));
    this.element.hidden = this.jobs.length === 0 || !job.keep_mesh;
    this.choice.replaceChildren(
      option("", "with no other job"),
      ...this.jobs.map((other) => option(other.id, brief(other))),
    );
  }

  /** Fetches the labels of the job that is chosen, with their energy. A hierarchy is cut at `clusters`. */
  async fetch(clusters: number | null, signal: AbortSignal): Promise<void> {
    const job = this.jobs.find(({ id }) => id === address.read().with);
    this.choice.value = job?.id ?? "";
    this.labels = this.measured = null;
    if (!job) return;
    const cut = isHierarchical(job.parameters.algorithm) ? (clusters ?? this.job.result?.clusters ?? null) : null;
    const shown = await labels(job, cut, signal);
    const report = await json<Report>(output(job, "report"), { signal });
    this.labels = shown;
    const isAlike = energyOf(job) === energyOf(this.job);
    this.measured = {
      clusters: cut ?? job.result?.clusters ?? 0,
      energy: !isAlike ? null : cut === null ? report.energy.final : shown.energy,
      compactness: cut === null ? compactness(report) : null,
    };
    this.captions.replaceChildren(make("span", {}, brief(this.job)), make("span", {}, brief(job)), this.line);
  }

  /** Says how this job's clusters compare with the other's. */
  tell(mine: Measured): void {
    this.wipe.disabled = this.labels === null;
    this.captions.hidden = this.labels === null;
    this.captions.classList.toggle("parted", this.wipe.checked);
    this.told.textContent = this.measured ? compared(mine, this.measured) : "";
  }
}

/** Energies of different numbers of clusters say nothing, so compactness is compared there. */
function compared(mine: Measured, other: Measured): string {
  if (mine.clusters === other.clusters && mine.energy && other.energy) {
    const change = 100 * (other.energy / mine.energy - 1);
    const how =
      Math.abs(change) < 5e-4
        ? "the same energy"
        : `${digits(Math.abs(change), 3)} % ${change > 0 ? "more" : "less"} energy`;
    return `The other job has ${how}: ${digits(other.energy)} against ${digits(mine.energy)}.`;
  }
  if (mine.compactness === null || other.compactness === null) return "";
  const percent = (part: number): string => `${(100 * part).toFixed(1)} %`;
  return `Compactness: ${percent(other.compactness)} of a honeycomb against ${percent(mine.compactness)} here.`;
}

const brief = (job: Job): string =>
  isHierarchical(job.parameters.algorithm) ? manner(job) : manner(job, `${count(job.result?.clusters ?? 0)} clusters`);

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
  return `cluster ${other}: ${count(faces)} faces, ${count(common)} in common`;
}
