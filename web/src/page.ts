// The page: a form for jobs, the list of jobs, and the job that the address names.

import * as address from "./address";
import { type Job, Refused, isHierarchical, isLive, json, nameOf, submit, token } from "./api";
import { announce, byId, make, notice } from "./dom";
import { type JobPage, describe, open } from "./job";
import { sample } from "./samples";

const ALGORITHMS: [string, string][] = [
  ["bb", "BB: boundary-based"],
  ["pml", "PML: hierarchy"],
  ["ml", "ML: hierarchy"],
  ["hr", "HR: hierarchy"],
  ["acvd", "ACVD"],
  ["vc", "VC: variational"],
];

/** Time between looks at the list of jobs, in milliseconds. */
const LOOK_EVERY = 2000;

/** Whether an algorithm has a quality; the others refuse it. */
const hasQuality = (algorithm: string): boolean => ["bb", "pml"].includes(algorithm);

let files: File[] = [];
let submitted: { id: string; file: File | null } | null = null;
let page: JobPage | null = null;
let turn = 0;

function choose(chosen: File[]): void {
  // the mesh first, then what belongs to it
  const isMesh = (file: File): boolean => /\.(obj|glb|gltf|ply|stl)$/i.test(file.name);
  files = [...chosen].sort((a, b) => Number(isMesh(b)) - Number(isMesh(a)));
  byId("file-name").textContent = files.map((file) => file.name).join(", ") || "or choose a file: OBJ, glTF, GLB";
  byId<HTMLButtonElement>("submit").disabled = files.length === 0;
}

async function start(): Promise<void> {
  const button = byId<HTMLButtonElement>("submit");
  const value = (id: string): string => byId<HTMLInputElement>(id).value;
  const algorithm = value("algorithm");
  const parameters: Record<string, unknown> = { algorithm, clusters: Number(value("clusters")), keep_mesh: true };
  if (hasQuality(algorithm)) parameters["quality"] = value("quality");
  // a hierarchy is made as a whole, so that the slider has all of it
  if (isHierarchical(algorithm)) delete parameters["clusters"];
  button.disabled = true;
  try {
    announce("Sending the mesh");
    const job = await submit(files, parameters);
    notice("");
    announce(`${nameOf(job)} is accepted`);
    submitted = { id: job.id, file: files.length === 1 ? (files[0] ?? null) : null };
    location.hash = address.ofJob(job.id);
    await list();
  } catch (error) {
    fail(error);
  } finally {
    button.disabled = files.length === 0;
  }
}

function fail(error: unknown): void {
  notice(
    error instanceof TypeError
      ? "The service does not answer."
      : error instanceof Error
        ? error.message
        : String(error),
  );
  if (error instanceof Refused && error.status === 401) byId("token-form").classList.add("needed");
}

/** What follows a job says that the service is gone, and for how long. */
function failUnlessGone(error: unknown): void {
  if (!(error instanceof TypeError)) fail(error);
}

/** The file of the job that was submitted last. */
const fileOf = (id: string): File | null => (submitted?.id === id ? submitted.file : null);

/** Shows the job of the address, or what the first visit shows. */
async function route(): Promise<void> {
  const mine = ++turn;
  page?.close();
  page = null;
  const box = byId("job");
  const { job } = address.read();
  byId("first-visit").hidden = job !== null;
  box.hidden = job === null;
  document.title = "Tesserae";
  try {
    const opened = await open(box, () => void list().catch(failUnlessGone), fileOf);
    if (mine !== turn) return opened?.close();
    page = opened;
    notice("");
    document.title = opened ? `${box.querySelector("h2")?.textContent ?? ""} – Tesserae` : "Tesserae";
    await page?.run();
  } catch (error) {
    if (mine === turn) fail(error);
  }
}

/** Writes the list of jobs, where it changed. */
async function list(): Promise<void> {
  const { jobs } = await json<{ jobs: Job[] }>("/v1/jobs?limit=50");
  const box = byId("jobs");
  const text = JSON.stringify(jobs.map((job) => [job.id, job.state, job.queue_position, location.hash]));
  if (box.dataset["shown"] === text) return;
  box.dataset["shown"] = text;
  const current = address.read().job;
  const focused = document.activeElement?.getAttribute("href");
  box.replaceChildren(
    ...jobs.map((job) => {
      const link = make("a", { href: address.ofJob(job.id) }, nameOf(job));
      if (job.id === current) link.setAttribute("aria-current", "page");
      const { algorithm, clusters } = job.parameters;
      const brief = isLive(job) ? describe(job) : job.state;
      return make("li", {}, link, make("span", {}, `${algorithm}${clusters ? ` ${clusters}` : ""} · ${brief}`));
    }),
  );
  if (jobs.length === 0) box.append(make("li", {}, "none yet"));
  const link = [...box.querySelectorAll("a")].find((a) => a.getAttribute("href") === focused);
  if (focused?.startsWith("#/jobs/")) link?.focus();
}

async function look(): Promise<void> {
  if (!document.hidden) {
    await list().catch(failUnlessGone);
  }
  setTimeout(() => void look(), LOOK_EVERY);
}

/** Who answers, and on what it clusters. */
async function describeService(): Promise<void> {
  const { version } = await json<{ version: string }>("/v1/version");
  byId("version").textContent = `Tesserae ${version}`;
  const device = await json<{ name: string; kind: string }>("/v1/device");
  byId("device").textContent = `clusters on ${device.kind}: ${device.name}`;
}

function listen(): void {
  const drop = byId("drop");
  const input = byId<HTMLInputElement>("file");
  input.addEventListener("change", () => choose([...(input.files ?? [])]));
  for (const name of ["dragover", "drop"]) document.addEventListener(name, (event) => event.preventDefault());
  document.addEventListener("dragover", () => drop.classList.add("over"));
  document.addEventListener("dragleave", () => drop.classList.remove("over"));
  document.addEventListener("drop", (event) => {
    drop.classList.remove("over");
    choose([...(event.dataTransfer?.files ?? [])]);
  });
  for (const button of document.querySelectorAll<HTMLButtonElement>("[data-sample]")) {
    button.addEventListener("click", () => {
      choose([sample(button.dataset["sample"] ?? "")]);
      void start();
    });
  }
  const algorithm = byId<HTMLSelectElement>("algorithm");
  for (const [value, text] of ALGORITHMS) algorithm.append(make("option", { value }, text));
  algorithm.addEventListener("change", () => {
    byId<HTMLSelectElement>("quality").disabled = !hasQuality(algorithm.value);
    byId<HTMLInputElement>("clusters").disabled = isHierarchical(algorithm.value);
  });
  byId("new-job").addEventListener("submit", (event) => {
    event.preventDefault();
    void start();
  });
  byId<HTMLInputElement>("token").value = token.get();
  byId("token-form").addEventListener("submit", (event) => {
    event.preventDefault();
    token.set(byId<HTMLInputElement>("token").value.trim());
    byId("token-form").classList.remove("needed");
    notice("");
    void describeService().catch(fail);
    void list().catch(fail);
    void route();
  });
  window.addEventListener("hashchange", () => void route().then(list).catch(fail));
}

listen();
void describeService().catch(fail);
void route();
void look();
