// The slider over the numbers of clusters of a hierarchy, logarithmic, and the same number as a field.

import { make } from "./dom";

/** Places of the slider. */
const PLACES = 1000;

export class Level {
  readonly element: HTMLElement;
  private readonly range = make("input", {
    id: "level",
    type: "range",
    min: "0",
    max: String(PLACES),
    step: "any",
    oninput: () => this.move(this.clustersAt(Number(this.range.value))),
  });
  private readonly number = make("input", {
    id: "level-number",
    type: "number",
    onchange: () => this.move(Number(this.number.value) || this.least),
  });
  constructor(
    private readonly least: number,
    private readonly most: number,
    /** Called at every move by hand. */
    private readonly onMove: (clusters: number) => void,
    /** What clusters are called. */
    private readonly noun = "clusters",
  ) {
    this.number.min = String(least);
    this.number.max = String(most);
    this.number.setAttribute("aria-label", `Number of ${noun}`);
    const label = make("label", { for: "level" }, noun.charAt(0).toUpperCase() + noun.slice(1));
    this.element = make("div", { class: "level" }, label, this.range, this.number);
  }

  /** The nearest number of clusters that the hierarchy can be cut at. */
  within(clusters: number): number {
    return Math.min(Math.max(Math.round(clusters), this.least), this.most);
  }

  /** Shows a number of clusters. */
  set(clusters: number): void {
    const whole = Math.log(this.most / this.least);
    this.range.value = String(whole > 0 ? (PLACES * Math.log(clusters / this.least)) / whole : 0);
    this.range.setAttribute("aria-valuetext", `${clusters} ${this.noun}`);
    this.number.value = String(clusters);
  }

  private clustersAt(place: number): number {
    return this.least * (this.most / this.least) ** (place / PLACES);
  }

  private move(clusters: number): void {
    this.set(this.within(clusters));
    this.onMove(this.within(clusters));
  }
}
