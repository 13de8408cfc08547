// What leads on from a job: its link, and the same request for curl, the command line and Python.

import { type Job, isHierarchical, nameOf, token } from "./api";
import { announce, make } from "./dom";
import { kindOf } from "./kinds";

export function take(job: Job, clusters: () => number | null): HTMLElement {
  const kinds: [string, () => string][] = [
    ["Link", () => location.href],
    ["curl", () => curl(job)],
    ["Command", () => command(job, clusters())],
    ["Python", () => python(job, clusters())],
  ];
  // edges and weights of points may have come as files that are not known here
  const shown = kindOf(job) === "points" ? kinds.slice(0, 1) : kinds;
  const buttons = shown.map(([name, text]) => {
    const button = make("button", { type: "button", id: `copy-${name.toLowerCase()}` }, name);
    button.addEventListener("click", () => void copy(button, name, text()));
    return button;
  });
  return make("section", { id: "take" }, make("h3", {}, "Copy as"), make("div", { class: "tools" }, ...buttons));
}

async function copy(button: HTMLButtonElement, name: string, text: string): Promise<void> {
  // a page that is not from a secure place has no clipboard
  const done = await navigator.clipboard?.writeText(text).then(
    () => true,
    () => false,
  );
  if (!done) {
    const field = make("textarea", { readonly: true, "aria-label": name }, text);
    button.parentElement?.after(field);
    field.select();
    return;
  }
  button.textContent = "Copied";
  announce(`${name} is copied`);
  setTimeout(() => (button.textContent = name), 2000);
}

/** The name of the mesh without folders, as no name from elsewhere may point at another file, or at a flag. */
function fileOf(job: Job): string {
  const name = nameOf(job).replace(/^.*[/\\]|[\0-\x1f\x7f]/gs, "");
  return name.replace(/^(\.*)$/, `mesh.${job.mesh.format}`).replace(/^-/, "./-");
}

/** Whether a buffer lies beside the mesh, or in a folder there that is not hidden. */
const isBeside = (name: string): boolean => !/^[/\\]|^\w:|(^|[/\\])\.|[\0-\x1f\x7f]/.test(name);

/** A word of a shell. */
const quoted = (word: string): string => (/^[\w./:@=-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`);

/** Parameters of a job that every algorithm takes, as far as they are set. */
export function settings(job: Job): [string, string | number | true][] {
  const names = [
    "clusters",
    "levels",
    "energy",
    "shapes",
    "resolution",
    "tolerance",
    "quality",
    "seed",
    "subdivide",
    "curvature_exponent",
    "bridge_components",
    "features",
    "compactness",
  ];
  const isSet = (value: unknown): value is string | number | true =>
    value === true || ((typeof value === "number" || typeof value === "string") && Boolean(value) && value !== "cvd");
  return names.flatMap((name) => {
    const given = job.parameters[name];
    const value = Array.isArray(given) ? given.join() : given;
    return isSet(value) ? [[name, value] as [string, string | number | true]] : [];
  });
}

/** What an image leaves: files that are made with the result, or itself, of which cuts are made. */
export const keptOf = (algorithm: string): Record<string, unknown> =>
  isHierarchical(algorithm) ? { keep_mesh: true } : { outputs: ["means", "clusters.csv", "clusters.json"] };

/** A form, whose parts need no type: the name of the file says its format, and buffers have parts of their own. */
function curl(job: Job): string {
  const { algorithm } = job.parameters;
  const isImage = kindOf(job) === "image";
  const kept = isImage ? keptOf(algorithm) : { keep_mesh: "true" };
  const search = new URLSearchParams({ algorithm, ...kept } as Record<string, string>);
  for (const [name, value] of settings(job)) search.set(name, String(value));
  const part = (of: string, name: string): string => ` -F ${quoted(`${of}=@"${name.replace(/["\\]/g, "\\$&")}"`)}`;
  const buffers = job.mesh.buffers.filter(isBeside).map((name) => part("buffer", name));
  const files = part(isImage ? "points" : "mesh", fileOf(job)) + buffers.join("");
  // a token itself is no text to hand on
  const mine = token.get() === "" ? "" : ' -H "Authorization: Bearer $TOKEN"';
  return `curl -sS${mine}${files} '${location.origin}/v1/jobs?${search}'`;
}

function command(job: Job, cut: number | null): string {
  const { algorithm } = job.parameters;
  const name = quoted(fileOf(job));
  const flags = settings(job).map(
    ([name, value]) => ` --${name.replaceAll("_", "-")}${value === true ? "" : ` ${value}`}`,
  );
  const options = `--algorithm ${algorithm}${flags.join("")}`;
  const image = "--labels labels.png --means means.png --clusters-table clusters.csv";
  const isImage = kindOf(job) === "image";
  const files = isImage ? image : "--labels labels.npy --mesh clusters.glb";
  if (!isHierarchical(algorithm)) return `tesserae cluster ${name} ${options} ${files}`;
  const run = `tesserae cluster ${name} ${options} --hierarchy hierarchy.tsr`;
  return `${run}\ntesserae cut hierarchy.tsr --clusters ${cut ?? 1} --labels labels.${isImage ? "png" : "npy"}`;
}

function python(job: Job, cut: number | null): string {
  const { algorithm } = job.parameters;
  const loaded = 'tesserae_mesh.Hierarchy.load("hierarchy.tsr")';
  const literal = (value: string | number | true): string => (value === true ? "True" : JSON.stringify(value));
  const options = [`algorithm="${algorithm}"`, ...settings(job).map(([name, value]) => `${name}=${literal(value)}`)];
  if (kindOf(job) === "image" && isHierarchical(algorithm))
    return `import tesserae_mesh\n\n# made by the command\nlabels = ${loaded}.cut(${cut ?? 1}).labels`;
  if (kindOf(job) === "image") {
    // what PNG has and JPEG has not is alpha
    const mode = job.mesh.format === "png" ? "RGBA" : "RGB";
    const read = `image = np.asarray(Image.open(${JSON.stringify(fileOf(job))}).convert("${mode}"))`;
    const call = `tesserae_mesh.superpixels(image, ${options.slice(1).join(", ").replace("clusters=", "n=")})`;
    return `import numpy as np\nimport tesserae_mesh\nfrom PIL import Image\n\n${read}\nlabels = ${call}`;
  }
  const labels = isHierarchical(algorithm) ? `result.hierarchy.cut(${cut ?? 1}).labels` : "result.labels";
  const call = `tesserae_mesh.cluster(${JSON.stringify(fileOf(job))}, ${options.join(", ")})`;
  return `import tesserae_mesh\n\nresult = ${call}\nlabels = ${labels}`;
}
