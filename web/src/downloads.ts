// Every file of a job with its size. Files are fetched with the token and handed over as blobs: a link has no header.

import { type Job, isHierarchical, length, nameOf, output, request } from "./api";
import { make, notice, size } from "./dom";

/** Extensions of each output; those of the first group need no mesh. */
const ALWAYS: Record<string, string[]> = { labels: ["npy", "json", "bin"], report: ["json"] };
const TREE: Record<string, string[]> = { hierarchy: ["tsr", "json"] };
const OF_MESH: Record<string, string[]> = {
  mesh: ["glb", "ply", "vtp", "obj"],
  submeshes: ["glb", "zip", "stl.zip", "obj.zip", "npz"],
  remesh: ["ply", "glb", "obj", "stl", "vtp"],
  "remesh-source": ["npz"],
  graph: ["json", "npz", "graphml"],
  boundaries: ["json", "obj", "glb", "vtp"],
  clusters: ["json", "csv"],
};

/** Outputs that a cut of a hierarchy changes. */
const NOT_CUT = ["report", "hierarchy"];

export function downloads(job: Job, clusters: () => number | null, signal: AbortSignal): HTMLElement {
  const list = make("ul", { id: "downloads" });
  const box = make("details", {}, make("summary", {}, "Downloads"), list);
  box.addEventListener("toggle", () => {
    if (box.open) void fill(list, job, clusters(), signal);
  });
  return box;
}

async function fill(list: HTMLElement, job: Job, clusters: number | null, signal: AbortSignal): Promise<void> {
  const offered = Object.entries(OF_MESH).filter(([name]) => job.urls[name]);
  const tree = isHierarchical(job.parameters.algorithm) ? Object.entries(TREE) : [];
  const sizes: (() => Promise<void>)[] = [];
  const rows = [...Object.entries(ALWAYS), ...tree, ...offered].map(([name, extensions]) => {
    const items = extensions.map((extension) => {
      const cut = NOT_CUT.includes(name) ? null : clusters;
      const format = name === "report" ? null : extension;
      const path = output(job, name, { format, clusters: cut });
      const told = make("span", { class: "size" });
      const file = `${stem(job)}-${name}${cut === null ? "" : `-${cut}`}.${extension}`;
      const button = make("button", { type: "button", onclick: () => void save(path, file, told, signal) }, extension);
      button.setAttribute("aria-label", `Download ${name} as ${extension}`);
      sizes.push(async () => {
        const bytes = await length(path, signal);
        if (bytes !== null) told.textContent = size(bytes);
      });
      return make("span", { class: "file" }, button, told);
    });
    return make("li", {}, make("strong", {}, name), ...items);
  });
  list.replaceChildren(...rows);
  // one after the other: the service makes some of them for this
  for (const ask of sizes) await ask().catch(() => {});
}

const stem = (job: Job): string =>
  nameOf(job)
    .replace(/\.[^.]*$/, "")
    .replace(/[^\w.-]+/g, "_");

async function save(path: string, name: string, told: HTMLElement, signal: AbortSignal): Promise<void> {
  try {
    const blob = await (await request(path, { signal })).blob();
    told.textContent = size(blob.size);
    const url = URL.createObjectURL(blob);
    make("a", { href: url, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(url), 60_000);
  } catch (error) {
    notice(`${name}: ${error instanceof Error ? error.message : String(error)}`);
  }
}
