// The same mesh or image once more: with another number of clusters, or with what repairs a failure. It is sent from
// the files of this page, or a mesh as the service kept it.

import * as address from "./address";
import { type Job, firstCut, isHierarchical, nameOf, output, request } from "./api";
import { announce, make, report } from "./dom";
import { WORDS, kindOf } from "./kinds";
import { send } from "./send";
import { keptOf, settings } from "./take";
import { uploaded } from "./uploaded";

/** Compactness of an image where none is named. */
export const USUAL_COMPACTNESS = 10;

type Parameters = Record<string, unknown>;

/** What a failure can be repaired with. */
interface Repair {
  text: string;
  /** Parameters that change, or the name of a file that is missing. */
  change: Parameters | string;
}

/** A failure in the page's words, and what repairs it. */
export function explain(job: Job): { words: string; repairs: Repair[] } {
  const detail = job.problem?.detail ?? job.problem?.title ?? "no reason is known";
  const { has } = WORDS[kindOf(job)];
  const parts = /number of connected components, (\d+)/.exec(detail)?.[1];
  if (parts) {
    const words = `${has} ${parts} separate parts. A cluster cannot cross a gap: it takes at least ${parts} clusters.`;
    const join: Repair = { text: "Join parts", change: { bridge_components: true } };
    return { words, repairs: [{ text: `Cluster with ${parts}`, change: { clusters: Number(parts) } }, join] };
  }
  const regions = /number of regions, (\d+)/.exec(detail)?.[1];
  if (regions) {
    const words = `Feature edges divide the mesh into ${regions} regions: it takes at least ${regions} clusters.`;
    return { words, repairs: [{ text: `Cluster with ${regions}`, change: { clusters: Number(regions) } }] };
  }
  const missing = /a buffer that did not come with it.*: "(.*)"$/.exec(detail)?.[1];
  if (missing)
    return {
      words: `The mesh needs ${missing}, which was not chosen.`,
      repairs: [{ text: `Add ${missing}`, change: missing }],
    };
  const [, noun, faces] = /clusters must not be more than there are (\w+), (\d+)/.exec(detail) ?? [];
  if (faces) {
    const words = `${has} ${faces} ${noun}, and there are at most as many clusters.`;
    return { words, repairs: [{ text: `Cluster with ${faces}`, change: { clusters: Number(faces) } }] };
  }
  return { words: detail, repairs: [] };
}

/**
 * Buttons that send the mesh or the image of a job that failed or was cancelled again; files that are missing are chosen
 * first.
 */
export function repairs(job: Job, files: File[], onSent: (job: Job, files: File[]) => void): HTMLElement[] {
  const found = job.state === "cancelled" ? [{ text: "Cluster again", change: {} }] : explain(job).repairs;
  return found.map(({ text, change }) => {
    const once = (all: File[]): void => void again(job, typeof change === "string" ? {} : change, all, onSent);
    if (typeof change !== "string" && files.length > 0)
      return make("button", { type: "button", class: "mend", onclick: () => once(files) }, text);
    const input = make("input", { type: "file", multiple: true, class: "hidden-text" });
    input.addEventListener("change", () => once([...files, ...(input.files ?? [])]));
    const joined = typeof change === "string" ? ` and ${change}` : `, ${text[0]?.toLowerCase()}${text.slice(1)}`;
    const chosen = files.length > 0 ? text : `Choose the ${kindOf(job)}${joined}`;
    return make("label", { class: "mend button" }, chosen, input);
  });
}

/** Fields and a button: the mesh of a job with another number of clusters, an image with another compactness, too. */
export function withAnother(job: Job, files: File[], onSent: (job: Job, files: File[]) => void): HTMLElement {
  const { algorithm, clusters } = job.parameters;
  const kind = kindOf(job);
  const isAny = isHierarchical(algorithm) && kind === "mesh";
  const value = String(isAny ? 400 : (firstCut(job) ?? clusters ?? 400));
  const field = make("input", { type: "number", id: "again-clusters", min: "1", step: "1", required: true, value });
  const compactness = make("input", { type: "number", id: "again-compactness", min: "0.001", step: "any" });
  compactness.value = String(job.parameters["compactness"] ?? USUAL_COMPACTNESS);
  const fields = [pair(field, WORDS[kind].clusters), ...(kind === "image" ? [pair(compactness, "compactness")] : [])];
  const tools = make("div", { class: "tools" }, ...fields, make("button", {}, "Cluster"));
  const form = make("form", { id: "again" }, make("h3", {}, "Again with"), tools);
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const flat = isHierarchical(algorithm) ? { algorithm: "bb", levels: undefined } : {};
    const more = kind === "image" ? { compactness: Number(compactness.value) } : {};
    void again(job, { ...flat, ...more, clusters: Number(field.value) }, files, onSent);
  });
  return form;
}

const pair = (field: HTMLInputElement, word: string): HTMLElement =>
  make("span", { class: "pair" }, field, make("label", { for: field.id }, word));

async function again(
  job: Job,
  change: Parameters,
  given: File[],
  onSent: (job: Job, files: File[]) => void,
): Promise<void> {
  try {
    const kind = kindOf(job);
    announce(`Sending the ${kind}`);
    const of: Parameters = { algorithm: job.parameters.algorithm, ...Object.fromEntries(settings(job)), ...change };
    const kept = kind === "image" ? keptOf(String(of["algorithm"])) : { keep_mesh: true };
    // a hierarchy of an image has a level in place of the number
    if (kind === "image" && of["levels"] && change["clusters"])
      [of["levels"], of["clusters"]] = [[change["clusters"]], undefined];
    const [{ signal }, idle] = [new AbortController(), (): void => {}];
    const isMesh = given.length === 0 && kind === "mesh";
    const fetched = given.length > 0 ? given : isMesh ? [await fetchKept(job)] : await uploaded(job, signal);
    const sent = await send(fetched, { ...kept, ...of }, signal, idle, idle, isMesh ? "ply" : null);
    onSent(sent, given);
    location.hash = address.ofJob(sent.id);
  } catch (error) {
    report(error);
  }
}

/** The mesh as the service kept it: as PLY, whose faces are in upload order and whose positions are exact. */
async function fetchKept(job: Job): Promise<File> {
  const blob = await (await request(output(job, "mesh", { format: "ply" }))).blob();
  return new File([blob], nameOf(job));
}
