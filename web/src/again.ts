// The same mesh once more: with another number of clusters, or with what repairs a failure. It is sent from the files of
// this page, or as the service kept it.

import * as address from "./address";
import { type Job, isHierarchical, nameOf, output, request } from "./api";
import { announce, make, notice } from "./dom";
import { send } from "./send";
import { settings } from "./take";

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
  const parts = /number of connected components, (\d+)/.exec(detail)?.[1];
  if (parts) {
    const words = `The mesh has ${parts} separate parts, and a cluster cannot reach across a gap: it takes at least ${parts} clusters.`;
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
  const faces = /clusters must not be more than there are faces, (\d+)/.exec(detail)?.[1];
  if (faces) {
    const words = `The mesh has ${faces} faces, and there are at most as many clusters.`;
    return { words, repairs: [{ text: `Cluster with ${faces}`, change: { clusters: Number(faces) } }] };
  }
  return { words: detail, repairs: [] };
}

/** Buttons that send the mesh of a failed job again. */
export function repairs(job: Job, files: File[], onSent: (job: Job, files: File[]) => void): HTMLElement[] {
  if (files.length === 0) return [];
  return explain(job).repairs.map(({ text, change }) => {
    const once = (changed: Parameters, all: File[]): void => void again(job, changed, all, onSent);
    if (typeof change !== "string")
      return make("button", { type: "button", class: "mend", onclick: () => once(change, files) }, text);
    const input = make("input", { type: "file", multiple: true, class: "hidden-text" });
    input.addEventListener("change", () => once({}, [...files, ...(input.files ?? [])]));
    return make("label", { class: "mend button" }, text, input);
  });
}

/** A field and a button: the mesh of a job with another number of clusters. */
export function withAnother(job: Job, files: File[], onSent: (job: Job, files: File[]) => void): HTMLElement {
  const { algorithm, clusters } = job.parameters;
  const value = String(isHierarchical(algorithm) ? 400 : (clusters ?? 400));
  const field = make("input", { type: "number", id: "again-clusters", min: "1", step: "1", required: true, value });
  const form = make(
    "form",
    { id: "again" },
    make("h3", {}, "Again with"),
    make(
      "div",
      { class: "tools" },
      field,
      make("label", { for: "again-clusters" }, "clusters"),
      make("button", {}, "Cluster"),
    ),
  );
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const flat = isHierarchical(algorithm) ? { algorithm: "bb" } : {};
    void again(job, { ...flat, clusters: Number(field.value) }, files, onSent);
  });
  return form;
}

async function again(
  job: Job,
  change: Parameters,
  given: File[],
  onSent: (job: Job, files: File[]) => void,
): Promise<void> {
  try {
    announce("Sending the mesh");
    const { algorithm } = job.parameters;
    const parameters: Parameters = { algorithm, keep_mesh: true, ...Object.fromEntries(settings(job)), ...change };
    const files = given.length > 0 ? given : [await kept(job)];
    const sent = await send(
      files,
      parameters,
      new AbortController().signal,
      () => {},
      () => {},
      given.length > 0 ? null : "ply",
    );
    onSent(sent, given);
    location.hash = address.ofJob(sent.id);
  } catch (error) {
    notice(error instanceof Error ? error.message : String(error));
  }
}

/** The mesh as the service kept it: as PLY, whose faces are in upload order and whose positions are exact. */
async function kept(job: Job): Promise<File> {
  const blob = await (await request(output(job, "mesh", { format: "ply" }))).blob();
  return new File([blob], nameOf(job));
}
