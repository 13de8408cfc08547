// The page: a form for jobs, the list of jobs, and the job that the address names.

import * as address from "./address";
import { GONE, type Job, Refused, isHierarchical, isLive, json, nameOf, token } from "./api";
import { announce, byId, make, notice, size } from "./dom";
import { type JobPage, describe, open } from "./job";
import { scene } from "./load";
import { type Progress, send } from "./send";

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
let submitted: { id: string; files: File[] } | null = null;
let sending: AbortController | null = null;
let page: JobPage | null = null;
let turn = 0;
let isGone = false;

function choose(chosen: File[]): void {
  if (chosen.length === 0) return;
  // the mesh first, then what belongs to it
  const isMesh = (file: File): boolean => /\.(obj|glb|gltf|ply|stl)$/i.test(file.name);
  files = [...chosen].sort((a, b) => Number(isMesh(b)) - Number(isMesh(a)));
  byId("file-name").textContent = files.map((file) => `${file.name}, ${size(file.size)}`).join("; ");
  byId<HTMLButtonElement>("submit").disabled = sending !== null;
}

async function start(): Promise<void> {
  if (sending) return;
  const button = byId<HTMLButtonElement>("submit");
  const value = (id: string): string => byId<HTMLInputElement>(id).value;
  const algorithm = value("algorithm");
  const parameters: Record<string, unknown> = { algorithm, clusters: Number(value("clusters")), keep_mesh: true };
  if (hasQuality(algorithm)) parameters["quality"] = value("quality");
  // a hierarchy is made as a whole, so that the slider has all of it
  if (isHierarchical(algorithm)) delete parameters["clusters"];
  const mine = files;
  button.disabled = true;
  sending = new AbortController();
  const { signal } = sending;
  const began = performance.now();
  const tell = (progress: Progress): void => tellSent(progress, (performance.now() - began) / 1000);
  tell({ sent: 0, total: mine.reduce((sum, file) => sum + file.size, 0) });
  byId("sending").hidden = false;
  try {
    announce("Sending the mesh");
    const job = await send(mine, parameters, signal, tell, () =>
      notice("The service does not answer. The mesh is sent again when it is back."),
    );
    notice("");
    announce(`${nameOf(job)} is accepted`);
    submitted = { id: job.id, files: mine };
    location.hash = address.ofJob(job.id);
    await list();
  } catch (error) {
    if (signal.aborted) announce("The mesh is not sent");
    else fail(error);
  } finally {
    sending = null;
    byId("sending").hidden = true;
    button.disabled = files.length === 0;
  }
}

/** Says how much of the mesh is sent, and how long the rest takes at the pace so far. */
function tellSent({ sent, total }: Progress, seconds: number): void {
  const bar = byId<HTMLProgressElement>("sent");
  bar.max = total;
  bar.value = sent;
  const rest = Math.ceil((seconds * (total - sent)) / sent);
  const text = sent < total ? `${size(sent)} of ${size(total)}` : `${size(total)} sent, waiting for the answer`;
  byId("sent-text").textContent = sent > 0 && sent < total ? `${text}, ${rest} s left` : text;
}

function fail(error: unknown): void {
  if (error instanceof TypeError) isGone = true;
  notice(error instanceof TypeError ? GONE : error instanceof Error ? error.message : String(error));
  if (error instanceof Refused && error.status === 401) {
    byId("token-form").classList.add("needed");
    // what another token showed
    byId("jobs").replaceChildren();
    delete byId("jobs").dataset["shown"];
  }
}

/** The files of the job that was submitted last. */
const filesOf = (id: string): File[] => (submitted?.id === id ? submitted.files : []);

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
    const opened = await open(box, () => void list().catch(fail), filesOf);
    if (mine !== turn) return opened?.close();
    page = opened;
    notice("");
    // on a narrow screen the job is below the form and the list
    if (opened && matchMedia("(max-width: 52rem)").matches) byId("main").scrollIntoView();
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
  if (focused?.startsWith("#/jobs/")) link?.focus({ preventScroll: true });
}

/** Looks at the list of jobs again and again; when the service is back, goes on with what was not there. */
async function look(): Promise<void> {
  if (!document.hidden) {
    try {
      await list();
      if (isGone) {
        isGone = false;
        notice("");
        void describeService().catch(fail);
        if (!page) void route();
      }
    } catch (error) {
      fail(error);
    }
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
      const name = button.dataset["sample"] ?? "";
      void scene()
        .then(({ sample }) => {
          choose([sample(name)]);
          return start();
        })
        .catch(fail);
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
  byId("stop").addEventListener("click", () => sending?.abort());
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
// what draws is there before it is needed, but after the first picture of the page
new PerformanceObserver((_, observer) => {
  observer.disconnect();
  void scene().catch(() => {});
}).observe({ type: "paint", buffered: true });
