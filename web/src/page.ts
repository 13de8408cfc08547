// The page: a form for jobs, the list of jobs, and the job that the address names.

import * as address from "./address";
import { GONE, type Job, Refused, json, token } from "./api";
import { byId, make, notice, report } from "./dom";
import { Form } from "./form";
import { type JobPage, open } from "./job";
import { list } from "./list";
import { scene } from "./load";
import { isDeleted, resume } from "./trash";
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
  report(error instanceof TypeError ? GONE : error);
  if (error instanceof Refused && error.status === 401) {
    byId("token-form").hidden = false;
    // what another token showed
    byId("jobs").replaceChildren();
    delete byId("jobs").dataset["shown"];
  }
}

/** Reports why the job of the address cannot be shown; one that the service does not have is closed. */
function failJob(error: unknown): void {
  if (error instanceof Refused && error.status === 404) {
    page?.close();
    page = null;
    byId("job").replaceChildren(nothing());
  }
  fail(error);
}

const around = {
  onChange: () => void list().catch(fail),
  onSent: (job: Job, files: File[]) => void sent.set(job.id, files),
};

/** Shows the job of the address, or what the first visit shows. */
async function route(): Promise<void> {
  const mine = ++turn;
  address.arrive();
  page?.close();
  visit?.close();
  page = visit = null;
  const box = byId("job");
  const { job } = address.read();
  byId("first-visit").hidden = job !== null;
  box.hidden = job === null;
  document.title = "Tesserae";
  // the notice belongs to the page before
  if (!isGone) notice("");
  try {
    if (job === null) {
      visit = new Visit(byId("first-visit"));
      return await (form.chosen.length > 0 ? visit.preview(form.chosen) : visit.run());
    }
    if (isDeleted(job)) return box.replaceChildren(nothing());
    const opened = await open(box, around, (id) => sent.get(id) ?? []);
    if (mine !== turn) return opened?.close();
    page = opened;
    // on a narrow screen the list is below the job
    byId("main").scrollIntoView();
    document.title = opened ? `${box.querySelector("h2")?.textContent ?? ""} – Tesserae` : "Tesserae";
    await page?.run();
  } catch (error) {
    if (mine === turn) failJob(error);
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
    const mine = turn;
    try {
      const jobs = await list();
      if (isGone) {
        isGone = false;
        notice("");
        void describeService().catch(fail);
        if (!page) void route();
      }
      // one that is not among the newest ones may be deleted
      const { job } = address.read();
      if (page && job !== null && !isDeleted(job) && !jobs.some(({ id }) => id === job)) await json(`/v1/jobs/${job}`);
    } catch (error) {
      if (mine === turn) failJob(error);
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
  const close = (event: Event, isOther: (menu: HTMLElement) => boolean): void => {
    for (const menu of document.querySelectorAll<HTMLDetailsElement>(".menu[open]")) {
      if (!isOther(menu)) continue;
      if (menu.contains(document.activeElement)) menu.querySelector("summary")?.focus();
      menu.open = false;
      // Escape does one thing
      if (event.type === "keydown") event.preventDefault();
    }
  };
  document.addEventListener("pointerdown", (event) => close(event, (menu) => !menu.contains(event.target as Node)));
  document.addEventListener("keydown", (event) => close(event, () => event.key === "Escape"));
  window.addEventListener("hashchange", () => void route().then(list).catch(fail));
}

listen();
resume(around.onChange);
const form = new Form(
  async (job, files) => {
    sent.set(job.id, files);
    location.hash = address.ofJob(job.id);
    await list();
  },
  fail,
  () => {
    const isJob = address.read().job !== null;
    if (isJob && form.chosen.length === 0) return;
    // without an event, so that what is said of the files stays
    if (isJob) history.pushState(null, "", "#/");
    void route();
  },
);
void describeService().catch(fail);
void route();
// the rest of the page needs nothing more: what draws comes meanwhile
void scene().catch(() => {});
void look();
