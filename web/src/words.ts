// Jobs in words.

import { explain } from "./again";
import { type Job, isHierarchical, now } from "./api";
import { count, duration } from "./dom";
import { WORDS, kindOf } from "./kinds";

/** What phases do; any other one moves or replaces whole clusters. */
const PHASES: Record<string, string> = {
  boundary: "settling borders",
  refine: "refining borders",
  repair: "joining pieces",
  regrow: "growing anew",
};

export const wordOf = (phase: string): string => PHASES[phase] ?? "moving whole clusters";

/** What a job does or did, in a line. */
export function describe(job: Job): string {
  const { phase, clusters_left: left } = job.progress;
  switch (job.state) {
    case "queued":
      return job.queue_position === null ? "Waiting" : `Waiting, number ${job.queue_position} in the queue`;
    case "running": {
      const step = left !== null ? `${count(left)} clusters left` : phase !== null ? wordOf(phase) : null;
      const since = job.started_at ? Math.floor((now() - Date.parse(job.started_at)) / 1000) : 0;
      return `Running${step === null ? "" : `: ${step}`}${since > 0 ? ` · ${since} s` : ""}`;
    }
    case "succeeded":
      return brief(job);
    case "failed":
      return `Failed: ${explain(job).words}`;
    case "cancelled":
      return "Cancelled";
  }
}

/** A job in a line: "400 clusters of 69,451 faces · 0.39 s". */
export function brief(job: Job, clusters: number | null = null): string {
  const { result, started_at: started, ended_at: ended } = job;
  if (!result) return "";
  const took = started && ended ? ` · ${duration(Date.parse(ended) - Date.parse(started))}` : "";
  const shown = clusters ?? result.clusters;
  const words = WORDS[kindOf(job)];
  const many = shown === 1 ? `1 ${words.cluster}` : `${count(shown)} ${words.clusters}`;
  const all = `${count(result.faces)} ${words.items}${took}`;
  const isWhole = isHierarchical(job.parameters.algorithm) && clusters === null;
  return `${isWhole ? `any number of ${words.clusters}` : many} of ${all}`;
}

/** Algorithms to compare with. */
const METHODS = ["ml", "hr", "acvd", "vc"];

const ENERGIES: Record<string, string> = { l21: "flat", planes: "planes", shapes: "simple shapes" };

/** What clusters are close to, where that is not their middle. */
export const energyOf = (job: Job): string | undefined => ENERGIES[String(job.parameters["energy"])];

/** How a job was made: "Given number · best". */
export function manner(
  job: Job,
  number = isHierarchical(job.parameters.algorithm) ? "Any number" : "Given number",
): string {
  const { algorithm, quality, compactness } = job.parameters;
  const method = METHODS.includes(algorithm) ? `, ${algorithm.toUpperCase()}` : "";
  const isFlatImage = kindOf(job) === "image" && !isHierarchical(algorithm);
  const parts = [isFlatImage ? "Superpixels" : `${number}${method}`];
  const energy = energyOf(job);
  if (energy) parts.push(energy);
  if (quality && quality !== "default") parts.push(quality);
  if (typeof compactness === "number") parts.push(`compactness ${compactness}`);
  return parts.join(" · ");
}

/** Warnings that begin with what is counted. */
const COUNTED = /^((?:(?:degenerate )?faces|rows|bytes|lines|solids|point and line elements)\b.*): ((?!1$)\d+)$/;

/** A warning of a report as a sentence: "12 degenerate faces." in place of "degenerate faces: 12". */
export function warned(text: string): string {
  const [, what, many] = COUNTED.exec(text) ?? [];
  const words = what && many ? `${count(Number(many))} ${what}` : text;
  return `${words.charAt(0).toUpperCase()}${words.slice(1)}.`;
}
