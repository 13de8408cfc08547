// One job: its state and energies while it runs, then what it gave.

import * as address from "./address";
import {
  GONE,
  type Job,
  type JobEvent,
  type State,
  follow,
  isHierarchical,
  isLive,
  json,
  nameOf,
  now,
  pause,
  request,
} from "./api";
import { repairs, withAnother } from "./again";
import { Before } from "./before";
import type { Curve } from "./curve";
import { announce, byId, make, notice, report } from "./dom";
import { kindOf } from "./kinds";
import { type Scene, scene } from "./load";
import type { Places } from "./places";
import { PointsResult } from "./points";
import { Result } from "./result";
import type { Coloured } from "./shown";
import { Superpixels } from "./superpixels";
import { remove } from "./trash";
import { uploaded } from "./uploaded";
import { describe, manner } from "./words";

/** Time between looks at whether a job that failed is run again, in milliseconds. */
const LOOK_EVERY = 2000;

/** What the page around a job does. */
export interface Around {
  /** Called when the job changes. */
  onChange: () => void;
  /** Called with a job of the same mesh, and with what was sent. */
  onSent: (job: Job, files: File[]) => void;
}

export class JobPage {
  private readonly abort = new AbortController();
  private readonly state = make("p", { id: "state" });
  private readonly actions = make("div", { id: "actions" });
  /** Buttons of a job without a result. */
  private readonly mends = make("div", { id: "mends", class: "tools" });
  private readonly energies = make("div", { id: "curve" });
  private readonly history = make("section", { "aria-label": "Energy" });
  private readonly aside = make("aside", { id: "inspector", "aria-label": "Inspector" });
  private readonly stage = make("div", { id: "stage" });
  private readonly inspector = make("div", { id: "result" });
  private readonly rest = make("div", { id: "rest" });
  private readonly curve: Curve;
  private result: Result | Superpixels | PointsResult | null = null;
  private before: Before | null = null;
  /** Number of the last event. */
  private last = "";

  constructor(
    private readonly box: HTMLElement,
    private job: Job,
    private readonly around: Around,
    /** What was submitted from here, mesh first; else an image that was fetched before the job ended. */
    private files: File[],
    private readonly scene: Scene,
  ) {
    const title = make("h2", { id: "job-title" }, nameOf(job));
    const head = make("header", { class: "head" }, title, this.state, this.mends);
    const manners = make("p", { class: "manner" }, manner(job));
    const { aside } = this;
    aside.append(make("div", { class: "bar" }, manners, this.actions), this.inspector, this.history, this.rest);
    box.replaceChildren(
      make("section", { id: "scene", "aria-label": kindOf(job) === "mesh" ? "Mesh" : "Image" }, this.stage, head),
      aside,
    );
    const { algorithm } = job.parameters;
    this.curve = new scene.Curve(this.energies, isHierarchical(algorithm));
    this.history.append(make("h3", {}, "Energy"), this.energies, this.curve.key);
    this.show();
  }

  /**
   * Follows the job, then shows its result; that of a job that has ended does not wait for its events. A job that failed
   * may be run again, and is followed then.
   */
  async run(): Promise<void> {
    const { signal } = this.abort;
    // the time goes on where a phase takes long
    const timer = setInterval(() => this.showState(), 1000);
    try {
      this.around.onChange();
      if (!isLive(this.job)) await Promise.all([this.whenThere(() => this.showResult()), this.followEvents()]);
      while (!signal.aborted) {
        if (!isLive(this.job) && !(await this.isRunAgain())) return;
        await this.followAttempt();
      }
    } catch (error) {
      if (!signal.aborted) report(error);
    } finally {
      clearInterval(timer);
    }
  }

  /** Whether the job ended without a result. */
  private get hasNone(): boolean {
    return ["failed", "cancelled"].includes(this.job.state);
  }

  close(): void {
    this.abort.abort();
    this.before?.close();
    this.result?.close();
    this.curve.dispose();
    this.box.replaceChildren();
  }

  private async followAttempt(): Promise<void> {
    this.showMesh();
    await this.followEvents();
    if (this.abort.signal.aborted) return;
    await this.whenThere(() => this.reload());
    if (isLive(this.job)) return;
    announce(`${nameOf(this.job)}: ${this.job.state}`);
    await this.whenThere(() => this.showResult());
  }

  /** Waits until a job that was given up is run again; false for any other, whose upload is gone. */
  private async isRunAgain(): Promise<boolean> {
    const { signal } = this.abort;
    const { ended_at: ended } = this.job;
    while (this.job.state === "failed" && this.job.urls.upload !== null) {
      await pause(LOOK_EVERY, signal);
      if (document.hidden) continue;
      await this.whenThere(async () => {
        const job = await json<Job>(`/v1/jobs/${this.job.id}`, { signal });
        // it may even have ended again
        if (job.ended_at !== ended) this.update(job);
      });
      if (this.job.ended_at !== ended) return true;
    }
    return false;
  }

  private async followEvents(): Promise<void> {
    this.last = await follow(this.job.id, this.last, this.abort.signal, (event) => this.take(event), notice);
  }

  private take(event: JobEvent): void {
    const { progress } = this.job;
    if (event.name === "state") {
      // another attempt begins anew
      this.curve.clear();
      Object.assign(progress, { iterations: 0, phase: null, clusters_left: null, energy: null });
      if (isLive(this.job)) this.enter(event.data.state);
    } else if (event.name === "iteration") {
      this.curve.iteration(event.data);
      const { iteration, phase, energy } = event.data;
      Object.assign(progress, { iterations: iteration + 1, phase, energy });
    } else if (event.name === "round") {
      this.curve.round(event.data);
      Object.assign(progress, { clusters_left: event.data.clusters, energy: event.data.energy });
    } else if (event.name === "labels") {
      return this.before?.take(event.data);
    }
    this.showState();
  }

  private enter(state: State): void {
    this.job.state = state;
    if (state === "running") this.job.started_at ??= new Date(now()).toISOString();
    this.around.onChange();
    if (state === "queued") void this.reload().catch(() => {});
  }

  private async reload(): Promise<void> {
    this.update(await json<Job>(`/v1/jobs/${this.job.id}`, { signal: this.abort.signal }));
  }

  private update(job: Job): void {
    this.job = job;
    this.show();
    this.around.onChange();
  }

  /** Does what takes the service, and does it again when the service went away meanwhile. */
  private async whenThere(work: () => Promise<void>): Promise<void> {
    for (let wait = 250; ; wait = Math.min(2 * wait, 4000)) {
      try {
        await work();
        if (wait > 250) notice("");
        return;
      } catch (error) {
        // what a request fails with that gets no answer
        if (!(error instanceof TypeError) || this.abort.signal.aborted) throw error;
        notice(GONE);
        await pause(wait, this.abort.signal);
      }
    }
  }

  private async showResult(): Promise<void> {
    if (this.job.state !== "succeeded") return;
    const running = this.before?.coloured ?? null;
    this.before?.close();
    this.before = null;
    this.result?.close();
    const places = { stage: this.stage, words: this.state, inspector: this.inspector, rest: this.rest };
    this.result = this.resultIn(places, running);
    if (this.job.keep_mesh || (kindOf(this.job) === "image" && this.files.length > 0))
      this.rest.prepend(withAnother(this.job, this.files, this.around.onSent));
    await this.result.load();
  }

  private resultIn(places: Places, running: Coloured | null): Result | Superpixels | PointsResult {
    const kind = kindOf(this.job);
    if (kind === "mesh") return new Result(places, this.job, this.scene, running);
    return kind === "image"
      ? new Superpixels(places, this.job, this.scene, this.files[0] ?? null)
      : new PointsResult(places, this.job);
  }

  /** Shows the mesh or the image while the service works on it. */
  private showMesh(): void {
    const kind = kindOf(this.job);
    if (this.before || kind === "points") return;
    this.before = new Before(this.stage, this.scene, kind);
    void this.before.show(this.readFiles());
  }

  private async readFiles(): Promise<File[]> {
    let { files } = this;
    if (files.length === 0) {
      await this.whenThere(async () => {
        files = await uploaded(this.job, this.abort.signal);
      });
      // the service has a mesh when it is needed again, but not each image
      if (kindOf(this.job) === "image") this.files = files;
    }
    return files;
  }

  private show(): void {
    const isRunning = isLive(this.job);
    const button = make("button", { type: "button", id: "remove" }, isRunning ? "Cancel" : "Delete");
    button.addEventListener("click", () => (isRunning ? void this.cancel() : this.remove()));
    const menu = make("details", { class: "menu" }, make("summary", { "aria-label": "More" }, "⋯"), button);
    const { hasNone } = this;
    this.actions.replaceChildren(...(hasNone ? [] : [isRunning ? button : menu]));
    this.mends.replaceChildren(...(hasNone ? [...repairs(this.job, this.files, this.around.onSent), button] : []));
    const kind = kindOf(this.job);
    if (hasNone && kind !== "points" && (this.files.length > 0 || this.job.urls["upload"])) this.showMesh();
    else if (hasNone && !this.before) {
      const words = kind === "points" ? "Points have no picture." : `The ${kind} was not kept.`;
      this.stage.replaceChildren(make("p", { class: "view" }, words));
    }
    this.showState();
  }

  private showState(): void {
    const words = describe(this.job);
    // the result says more of a job that has succeeded
    if (!this.result && this.state.textContent !== words) this.state.textContent = words;
    // one point is no curve
    this.history.hidden = this.curve.length < 2;
    this.aside.hidden = this.hasNone && this.history.hidden;
    this.state.dataset["state"] = this.job.state;
  }

  private remove(): void {
    remove(this.job.id, nameOf(this.job), this.around.onChange);
    byId("main").focus({ preventScroll: true });
    location.hash = "#/";
    this.around.onChange();
  }

  private async cancel(): Promise<void> {
    try {
      await request(`/v1/jobs/${this.job.id}?cancel=true`, { method: "DELETE" });
      announce("The job is being cancelled");
      this.around.onChange();
    } catch (error) {
      report(error);
    }
  }
}

/** Opens the job that the address names; a job that is not there is an error. */
export async function open(box: HTMLElement, around: Around, filesOf: (id: string) => File[]): Promise<JobPage | null> {
  const { job: id } = address.read();
  if (id === null) return null;
  const [job, loaded] = await Promise.all([json<Job>(`/v1/jobs/${id}`), scene()]);
  return new JobPage(box, job, around, filesOf(id), loaded);
}
