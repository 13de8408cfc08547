// What a job on points gave that come from elsewhere: numbers and files. There is nothing to draw of them.

import { type Job, type Report, isHierarchical, json, output } from "./api";
import { make } from "./dom";
import { downloads } from "./downloads";
import { Facts } from "./facts";
import type { Places } from "./places";
import { take } from "./take";
import { brief } from "./words";

/** Clusters of a cut of a hierarchy, for files and commands; there is no slider. */
const CUT = 100;

export class PointsResult {
  private readonly abort = new AbortController();

  constructor(
    private readonly places: Places,
    private readonly job: Job,
  ) {
    const view = make(
      "div",
      { id: "view", class: "view" },
      "Points have no picture here: their numbers and files are beside this.",
    );
    const { clusters = 1, faces = CUT } = job.result ?? {};
    const cut = isHierarchical(job.parameters.algorithm) ? Math.max(clusters, Math.min(CUT, faces)) : null;
    places.stage.replaceChildren(view);
    places.inspector.replaceChildren();
    places.words.textContent = brief(job, cut);
    places.rest.replaceChildren(
      downloads(job, () => cut, this.abort.signal),
      take(job, () => cut),
    );
  }

  async load(): Promise<void> {
    const report = await json<Report>(output(this.job, "report"), { signal: this.abort.signal });
    this.places.inspector.replaceChildren(new Facts(this.job, report).element);
  }

  close(): void {
    this.abort.abort();
  }
}
