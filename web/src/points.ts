// What a job on points gave that come from elsewhere: numbers and files. There is nothing to draw of them.

import { type Job, type Report, firstCut, json, output } from "./api";
import { make } from "./dom";
import { downloads } from "./downloads";
import { Facts } from "./facts";
import type { Places } from "./places";
import { take } from "./take";
import { brief } from "./words";

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
    // for files and commands; there is no slider
    const cut = firstCut(job);
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
