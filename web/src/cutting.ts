// The cut of a job that is shown, and its slider. While the slider moves, only the picture is updated; numbers are
// fetched when it rests.

import * as address from "./address";
import { type Job, firstCut, isHierarchical } from "./api";
import { WORDS, kindOf } from "./kinds";
import { Level } from "./level";

/** Time without a move of the slider after which numbers are fetched, in milliseconds. */
const REST = 80;

export class Cutting {
  /** Of a hierarchy. */
  readonly level: Level | null;
  /** The number of clusters; null of a flat clustering. */
  at: number | null = null;
  private working = new AbortController();
  private timer = 0;
  private frame = 0;

  constructor(
    job: Job,
    most: number,
    /** Called at most once a frame. */
    private readonly onMove: (clusters: number) => void,
    private readonly onRest: () => void,
  ) {
    const { clusters: least = 1 } = job.result ?? {};
    this.level = isHierarchical(job.parameters.algorithm)
      ? new Level(least, most, (clusters) => this.move(clusters), WORDS[kindOf(job)].clusters)
      : null;
    if (this.level) this.set(this.level.within(address.read().clusters ?? firstCut(job) ?? least));
  }

  /** Changes the cut, and fetches nothing. */
  set(clusters: number): void {
    clearTimeout(this.timer);
    cancelAnimationFrame(this.frame);
    this.at = clusters;
    this.level?.set(clusters);
  }

  /** Does what takes requests at the cut; null where it was done again meanwhile. */
  async latest<T>(work: (signal: AbortSignal) => Promise<T>): Promise<T | null> {
    this.working.abort();
    const working = new AbortController();
    this.working = working;
    try {
      const done = await work(working.signal);
      return working.signal.aborted ? null : done;
    } catch (error) {
      if (working.signal.aborted) return null;
      throw error;
    }
  }

  close(): void {
    clearTimeout(this.timer);
    cancelAnimationFrame(this.frame);
    this.working.abort();
  }

  private move(clusters: number): void {
    this.working.abort();
    this.at = clusters;
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => {
      address.amend({ clusters });
      this.onRest();
    }, REST);
    cancelAnimationFrame(this.frame);
    this.frame = requestAnimationFrame(() => this.onMove(clusters));
  }
}
