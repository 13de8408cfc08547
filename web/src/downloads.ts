// Every file of a job by purpose, with its size. Files are fetched with the token and handed over as blobs: a link has no
// header.

import { type Job, isHierarchical, length, nameOf, output, request } from "./api";
import { make, notice, save, size } from "./dom";
import { WORDS, kindOf } from "./kinds";

interface Row {
  /** What it is for. */
  word: string;
  output: string;
  extensions: string[];
}

const SPLIT = ["glb", "zip", "stl.zip", "obj.zip", "npz"];
const GROUPS: [string, Row[]][] = [
  [
    "Look",
    [
      { word: "mesh with colours of clusters", output: "mesh", extensions: ["glb", "ply", "vtp", "obj"] },
      { word: "image of mean colours", output: "means", extensions: ["png"] },
    ],
  ],
  ["Split", [{ word: "a mesh a cluster", output: "submeshes", extensions: SPLIT }]],
  [
    "Remesh",
    [
      { word: "a vertex a cluster", output: "remesh", extensions: ["ply", "glb", "obj", "stl", "vtp"] },
      { word: "what vertices come from", output: "remesh-source", extensions: ["npz"] },
    ],
  ],
  [
    "Data",
    [
      { word: "cluster of each face", output: "labels", extensions: ["png", "npy", "json", "bin"] },
      { word: "table of clusters", output: "clusters", extensions: ["csv", "json"] },
      { word: "neighbours of clusters", output: "graph", extensions: ["json", "npz", "graphml"] },
      { word: "lines between clusters", output: "boundaries", extensions: ["json", "obj", "glb", "vtp"] },
      { word: "all merges", output: "hierarchy", extensions: ["tsr", "json"] },
      { word: "energies and times", output: "report", extensions: ["json"] },
    ],
  ],
];

/** Outputs that a cut of a hierarchy changes not. */
const NOT_CUT = ["report", "hierarchy"];

/** Outputs that need no mesh. */
const ALWAYS = ["labels", "report"];

export function downloads(job: Job, clusters: () => number | null, signal: AbortSignal): HTMLElement {
  const list = make("div", { id: "downloads" });
  const box = make("details", {}, make("summary", {}, "Downloads"), list);
  box.addEventListener("toggle", () => box.open && void fill(list, job, clusters(), signal));
  return box;
}

/** The mesh with the colours of its clusters, at one click. */
export function mainDownload(job: Job, clusters: () => number | null, signal: AbortSignal): HTMLElement {
  const told = make("span", { class: "size" });
  const button = make("button", { type: "button", id: "glb", class: "main" }, "Download GLB", told);
  button.addEventListener("click", () => {
    const { path, file } = place(job, "mesh", "glb", clusters());
    void fetchFile(path, file, told, signal);
  });
  return button;
}

/** Address and name of a file, of a hierarchy at a number of clusters. */
function place(job: Job, name: string, extension: string, clusters: number | null): { path: string; file: string } {
  const cut = NOT_CUT.includes(name) ? null : clusters;
  const path = output(job, name, { format: name === "report" ? null : extension, clusters: cut });
  return { path, file: `${stem(job)}-${name}${cut === null ? "" : `-${cut}`}.${extension}` };
}

/** A row in the words and the formats of this job. */
function suited(row: Row, job: Job): Row {
  const { items, clusters, cluster } = WORDS[kindOf(job)];
  const isNamed = (extension: string): boolean => job.outputs.includes(`${row.output}.${extension}`);
  if (NOT_CUT.includes(row.output)) return row;
  if (row.output === "labels") {
    const extensions = row.extensions.filter((extension) => extension !== "png" || kindOf(job) === "image");
    return { ...row, word: `${cluster} of each ${items.slice(0, -1)}`, extensions };
  }
  const word = row.word.replace("clusters", clusters);
  return { ...row, word, extensions: job.keep_mesh ? row.extensions : row.extensions.filter(isNamed) };
}

const isMade = (job: Job, name: string): boolean =>
  ALWAYS.includes(name) || (name === "hierarchy" ? isHierarchical(job.parameters.algorithm) : Boolean(job.urls[name]));

async function fill(list: HTMLElement, job: Job, clusters: number | null, signal: AbortSignal): Promise<void> {
  const sizes: (() => Promise<void>)[] = [];
  const item = (name: string, extension: string): HTMLElement => {
    const { path, file } = place(job, name, extension, clusters);
    const told = make("span", { class: "size" });
    const get = (): void => void fetchFile(path, file, told, signal);
    const button = make("button", { type: "button", onclick: get }, extension.toUpperCase());
    button.setAttribute("aria-label", `Download ${name} as ${extension}`);
    sizes.push(async () => {
      const bytes = await length(path, signal);
      if (bytes !== null) told.textContent = size(bytes);
    });
    return make("span", { class: "file" }, button, told);
  };
  list.replaceChildren();
  for (const [title, all] of GROUPS) {
    const rows = all.filter((row) => isMade(job, row.output)).map((row) => suited(row, job));
    const files = rows.map(({ word, output: name, extensions }) => {
      const buttons = make("div", { class: "files" }, ...extensions.map((one) => item(name, one)));
      return make("div", {}, make("p", {}, word), buttons);
    });
    if (rows.length > 0) list.append(make("h3", {}, title), ...files);
  }
  // one after the other: the service makes some of them for this
  for (const ask of sizes) await ask().catch(() => {});
}

/** The name of a job's mesh, for names of files. */
export const stem = (job: Job): string =>
  nameOf(job)
    .replace(/\.[^.]*$/, "")
    .replace(/[^\w.-]+/g, "_");

async function fetchFile(path: string, name: string, told: HTMLElement, signal: AbortSignal): Promise<void> {
  try {
    const blob = await (await request(path, { signal })).blob();
    told.textContent = size(blob.size);
    save(blob, name);
  } catch (error) {
    notice(`${name}: ${error instanceof Error ? error.message : String(error)}`);
  }
}
