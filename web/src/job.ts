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
  pause,
  request,
} from "./api";
import type { Curve } from "./curve";
import { announce, count, digits, make, notice } from "./dom";
import { type Scene, scene } from "./load";
import { Result } from "./result";
import { uploaded } from "./uploaded";
import type { Triangles, View } from "./view";

/** Time between looks at whether a job that failed is run again, in milliseconds. */
const LOOK_EVERY = 2000;

export class JobPage {
  private readonly abort = new AbortController();
  private readonly state = make("p", { id: "state" });
  private readonly actions = make("div", { class: "tools" });
  private readonly energies = make("div", { id: "curve" });
  private readonly history = make("section", { "aria-label": "Energy" });
  private readonly shape = make("div");
  private readonly rest = make("div", { id: "result" });
  private readonly curve: Curve;
  private result: Result | null = null;
  private before: View | null = null;
  /** Number of the last event. */
  private last = "";

  constructor(
    private readonly box: HTMLElement,
    private job: Job,
    private readonly onChange: () => void,
    /** What was submitted, mesh first, if it was from here. */
    private readonly files: File[],
    private readonly scene: Scene,
  ) {
    const { algorithm, clusters, quality } = job.parameters;
    const facts = [algorithm, clusters ? `${count(clusters)} clusters` : "whole hierarchy", quality ?? ""];
    box.replaceChildren(
      make("h2", { id: "job-title" }, nameOf(job)),
      make("p", { class: "facts" }, facts.filter((fact) => fact !== "").join(" · ")),
      this.state,
      this.actions,
      this.shape,
      this.history,
      this.rest,
    );
    this.history.append(make("h3", {}, "Energy"), this.energies, make("p", { class: "key" }, ...keyOf(algorithm)));
    this.curve = new scene.Curve(this.energies, isHierarchical(algorithm));
    this.show();
  }

  /**
   * Follows the job, then shows its result; that of a job that has ended does not wait for its events. A job that failed
   * may be run again, and is followed then.
   */
  async run(): Promise<void> {
    const { signal } = this.abort;
    try {
      this.onChange();
      if (!isLive(this.job)) await Promise.all([this.whenThere(() => this.showResult()), this.followEvents()]);
      while (!signal.aborted) {
        if (!isLive(this.job) && !(await this.isRunAgain())) return;
        await this.followAttempt();
      }
    } catch (error) {
      if (!signal.aborted) notice(error instanceof Error ? error.message : String(error));
    }
  }

  close(): void {
    this.abort.abort();
    this.before?.dispose();
    this.result?.close();
    this.curve.dispose();
    this.box.replaceChildren();
  }

  private async followAttempt(): Promise<void> {
    void this.showMesh();
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
    const { signal } = this.abort;
    this.last = await follow(
      this.job.id,
      this.last,
      signal,
      (event) => this.take(event),
      (why) => notice(why),
    );
    if (!signal.aborted) this.history.hidden = this.curve.length === 0;
  }

  private take(event: JobEvent): void {
    const { progress } = this.job;
    if (event.name === "state") {
      // another attempt begins anew
      this.curve.clear();
      this.history.hidden = false;
      Object.assign(progress, { iterations: 0, phase: null, clusters_left: null, energy: null });
      if (isLive(this.job)) this.enter(event.data.state);
    } else if (event.name === "iteration") {
      this.curve.iteration(event.data);
      Object.assign(progress, {
        iterations: event.data.iteration + 1,
        phase: event.data.phase,
        energy: event.data.energy,
      });
    } else if (event.name === "round") {
      this.curve.round(event.data);
      Object.assign(progress, { clusters_left: event.data.clusters, energy: event.data.energy });
    }
    this.showState();
  }

  private enter(state: State): void {
    this.job.state = state;
    this.onChange();
    if (state === "queued") void this.reload().catch(() => {});
  }

  private async reload(): Promise<void> {
    this.update(await json<Job>(`/v1/jobs/${this.job.id}`, { signal: this.abort.signal }));
  }

  private update(job: Job): void {
    this.job = job;
    this.show();
    this.onChange();
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
    this.before?.dispose();
    this.before = null;
    this.result?.close();
    this.result = new Result(this.shape, this.rest, this.job, this.scene);
    await this.result.load();
  }

  /** Shows the mesh itself while the service works on it, or says why not. */
  private async showMesh(): Promise<void> {
    if (this.before) return;
    const figure = make("div", { class: "view", id: "preview" }, "Reading the mesh");
    this.shape.replaceChildren(figure);
    const mesh = await this.readMesh().catch((error: unknown) => {
      const why = error instanceof Error ? error.message : String(error);
      figure.textContent = `The mesh is shown when it is clustered, not before: ${why}.`;
      return null;
    });
    if (!mesh || this.result || !figure.isConnected) return;
    this.before = new this.scene.View(figure, mesh);
    this.before.canvas.setAttribute("role", "img");
    this.before.canvas.setAttribute("aria-label", "The mesh, not yet clustered");
  }

  private async readMesh(): Promise<Triangles> {
    let { files } = this;
    if (files.length === 0) {
      await this.whenThere(async () => {
        files = await uploaded(this.job, this.abort.signal);
      });
    }
    return await this.scene.preview(files);
  }

  private show(): void {
    const isRunning = isLive(this.job);
    const label = isRunning ? "Cancel" : "Delete";
    this.actions.replaceChildren(
      make("button", { type: "button", id: "remove", onclick: () => void this.remove() }, label),
    );
    this.showState();
  }

  private showState(): void {
    this.state.textContent = describe(this.job);
    this.state.dataset["state"] = this.job.state;
  }

  private async remove(): Promise<void> {
    const wasLive = isLive(this.job);
    try {
      await request(`/v1/jobs/${this.job.id}`, { method: "DELETE" });
      if (!wasLive) location.hash = "#/";
      announce(wasLive ? "The job is being cancelled" : "The job is deleted");
      this.onChange();
    } catch (error) {
      notice(error instanceof Error ? error.message : String(error));
    }
  }
}

/** A job in a line. */
export function describe(job: Job): string {
  const { iterations, phase, clusters_left: left, energy } = job.progress;
  switch (job.state) {
    case "queued":
      return job.queue_position === null ? "waiting" : `waiting, number ${job.queue_position} in the queue`;
    case "running": {
      if (energy === null) return "running";
      const step = left !== null ? `${count(left)} clusters left` : `iteration ${iterations}, ${phase ?? ""}`;
      return `running: ${step}, energy ${digits(energy)}`;
    }
    case "succeeded":
      return job.result
        ? `succeeded: ${count(job.result.faces)} faces, ${clustersOf(job, job.result.clusters)}`
        : "succeeded";
    case "failed":
      return `failed: ${job.problem?.detail ?? job.problem?.title ?? "no reason is known"}`;
    case "cancelled":
      return "cancelled";
  }
}

function clustersOf(job: Job, clusters: number): string {
  const text = clusters === 1 ? "1 cluster" : `${count(clusters)} clusters`;
  return isHierarchical(job.parameters.algorithm) ? `a hierarchy down to ${text}` : text;
}

function keyOf(algorithm: string): HTMLElement[] {
  if (isHierarchical(algorithm)) return [make("span", {}, "energy against the number of clusters, both logarithmic")];
  const phases = ["boundary", "refine", "repair", "regrow"];
  return phases.map((phase) => make("span", { class: `phase ${phase}` }, phase));
}

/** Opens the job that the address names; a job that is not there is an error. */
export async function open(
  box: HTMLElement,
  onChange: () => void,
  filesOf: (id: string) => File[],
): Promise<JobPage | null> {
  const { job: id } = address.read();
  if (id === null) return null;
  const [job, loaded] = await Promise.all([json<Job>(`/v1/jobs/${id}`), scene()]);
  return new JobPage(box, job, onChange, filesOf(id), loaded);
}
