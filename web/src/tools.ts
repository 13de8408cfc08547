// The tools over the view: what colours stand for, which way is up, edges of the remesh, a picture.

import * as address from "./address";
import type { Job, Shape } from "./api";
import { digits, make, option, swatch } from "./dom";
import { scale, css } from "./palette";
import type { Up } from "./ground";
import { angleOf, hasShapes, legend } from "./shapes";
import { energyOf } from "./words";

const NAMES = { area: "Size", roundness: "Roundness", energy: "Energy", shape: "Shape" };

/** What readers of screens hear before the numbers of a legend. */
const ENDS = ["least ", "middle ", "most "];

export class Tools {
  readonly element = make("div", { id: "tools", role: "group", "aria-label": "View", hidden: true });
  readonly legend = make("p", { id: "legend", hidden: true });
  onColours: () => void = () => {};
  onUp: (up: Up) => void = () => {};
  onOver: () => void = () => {};
  onPicture: () => void = () => {};
  /** Buttons of what is drawn over the mesh, of which one is pressed at most. */
  private readonly overlays = {
    remesh: make("button", { type: "button", id: "remesh" }, "Remesh"),
    edges: make("button", { type: "button", id: "sharp" }, "Edges"),
  };
  private readonly colours = make(
    "select",
    { id: "colours", "aria-label": "Colour by" },
    option("", "By cluster"),
    ...address.COLOURS.map((name) => option(name, `By ${NAMES[name].toLowerCase()}`)),
  );
  private readonly up = make("button", { type: "button", id: "up-axis" });

  private shapes: Shape[] = [];

  constructor(job: Job) {
    const hasRows = Boolean(job.urls["clusters"]);
    const isOther = energyOf(job) !== undefined;
    for (const item of [...this.colours.options]) {
      if ((item.value === "shape" && !hasShapes(job)) || (item.value === "energy" && isOther)) item.remove();
      item.disabled = ["roundness", "energy"].includes(item.value) && !hasRows;
    }
    this.colours.value = address.read().colours ?? "";
    this.colours.addEventListener("change", () => {
      address.amend({ colours: address.COLOURS.find((name) => name === this.colours.value) ?? null });
      this.onColours();
    });
    this.up.addEventListener("click", () => {
      const up = this.up.dataset["up"] === "y" ? "z" : "y";
      address.amend({ up });
      this.setUp(up);
      this.onUp(up);
    });
    for (const name of address.OVERLAYS) {
      this.overlays[name].addEventListener("click", () => {
        address.amend({ over: this.over === name ? null : name });
        this.press();
        this.onOver();
      });
    }
    const picture = make("button", { type: "button", id: "picture", onclick: () => this.onPicture() }, "PNG");
    picture.setAttribute("aria-label", "Save a picture of this view as PNG");
    const { remesh, edges } = this.overlays;
    edges.setAttribute("aria-label", `Edges at which the surface bends by more than ${angleOf(job)}°`);
    remesh.hidden = !job.urls["remesh"];
    edges.hidden = angleOf(job) === null;
    this.press();
    this.element.append(this.colours, this.up, remesh, edges, picture);
  }

  /** What is drawn over the mesh, of what there is. */
  get over(): address.Overlay | null {
    const { over } = address.read();
    return over && !this.overlays[over].hidden ? over : null;
  }

  /** Says which way is up; before there is a mesh, there are no tools. */
  setUp(up: Up): void {
    this.element.hidden = false;
    this.up.dataset["up"] = up;
    this.up.textContent = `${up.toUpperCase()} up`;
    this.up.setAttribute("aria-label", `${up.toUpperCase()} up, make it ${up === "y" ? "Z" : "Y"} up`);
  }

  /** Takes the shapes of the clusters, which the legend counts; cuts of hierarchies have none. */
  setShapes(shapes: Shape[]): void {
    this.shapes = shapes;
    if (shapes.length === 0) this.colours.querySelector("[value=shape]")?.remove();
    if (shapes.length === 0 && address.read().colours === "shape") address.amend({ colours: null });
  }

  private press(): void {
    for (const name of address.OVERLAYS) this.overlays[name].setAttribute("aria-pressed", String(this.over === name));
  }

  /** Says what the colours are: the least, the middle and the most of the numbers that they stand for. */
  tell(ends: number[]): void {
    const { colours } = address.read();
    this.legend.hidden = colours === null;
    if (colours === null) return;
    if (colours === "shape") {
      this.legend.replaceChildren(...legend(this.shapes).flatMap(([colour, text]) => [swatch(colour), text]));
      return;
    }
    const bar = make("span", { class: "scale" });
    bar.style.background = `linear-gradient(90deg, ${[0, 0.25, 0.5, 0.75, 1].map((at) => css(scale(at))).join(", ")})`;
    const numbers = ends.map((end, i) =>
      make("span", {}, make("span", { class: "hidden-text" }, ENDS[i] ?? ""), digits(end, 3)),
    );
    this.legend.replaceChildren(`${NAMES[colours]}, by rank`, make("span", { class: "ranks" }, bar, ...numbers));
  }
}
