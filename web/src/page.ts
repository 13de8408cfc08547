// The page: a form for jobs, the list of jobs, and the job that the address names.

import * as address from "./address";
import { GONE, type Job, Refused, json, token } from "./api";
import { byId, make, notice } from "./dom";
import { Form } from "./form";
import { type JobPage, open } from "./job";
import { list } from "./list";
import { scene } from "./load";
import { isDeleted } from "./trash";
import { Visit } from "./visit";

/** Time between looks at the list of jobs, in milliseconds. */
const LOOK_EVERY = 2000;

/** What was sent from here, mesh first. */
const sent = new Map<string, File[]>();
let page: JobPage | null = null;
let visit: Visit | null = null;
let turn = 0;
let isGone = false;

function fail(error: unknown): void {
  if (error instanceof TypeError) isGone = true;
  notice(error instanceof TypeError ? GONE : error instanceof Error ? error.message : String(error));
  if (error instanceof Refused && error.status === 401) {
    byId("token-form").hidden = false;
    // what another token showed
    byId("jobs").replaceChildren();
    delete byId("jobs").dataset["shown"];
  }
}

const around = {
  onChange: () => void list().catch(fail),
  onSent: (job: Job, files: File[]) => void sent.set(job.id, files),
};

/** Shows the job of the address, or what the first visit shows. */
async function route(): Promise<void> {
  const mine = ++turn;
  page?.close();
  visit?.close();
  page = visit = null;
  const box = byId("job");
  const { job } = address.read();
  byId("first-visit").hidden = job !== null;
  box.hidden = job === null;
  document.title = "Tesserae";
  try {
    if (job === null) {
      visit = new Visit(byId("first-visit"));
      return await visit.run();
    }
    const opened = isDeleted(job) ? null : await open(box, around, (id) => sent.get(id) ?? []);
    if (mine !== turn) return opened?.close();
    page = opened;
    notice("");
    // on a narrow screen the list is below the job
    byId("main").scrollIntoView();
    document.title = opened ? `${box.querySelector("h2")?.textContent ?? ""} – Tesserae` : "Tesserae";
    await page?.run();
  } catch (error) {
    if (mine !== turn) return;
    if (error instanceof Refused && error.status === 404) box.replaceChildren(nothing());
    fail(error);
  }
}

const nothing = (): HTMLElement =>
  make(
    "div",
    { class: "nothing" },
    make("h2", {}, "This job is not here"),
    make("a", { href: "#/" }, "Cluster a mesh"),
  );

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
  byId("device").textContent = `Clusters on ${device.kind}: ${device.name}`;
}

function listen(): void {
  byId<HTMLInputElement>("token").value = token.get();
  byId("token-form").addEventListener("submit", (event) => {
    event.preventDefault();
    token.set(byId<HTMLInputElement>("token").value.trim());
    byId("token-form").hidden = true;
    notice("");
    void describeService().catch(fail);
    void list().catch(fail);
    void route();
  });
  window.addEventListener("hashchange", () => void route().then(list).catch(fail));
}

listen();
new Form(async (job, files) => {
  sent.set(job.id, files);
  location.hash = address.ofJob(job.id);
  await list();
}, fail);
void describeService().catch(fail);
void route();
// the rest of the page needs nothing more: what draws comes meanwhile
void scene().catch(() => {});
void look();
