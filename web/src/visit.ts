// The first visit: a knot that turns, and the slider under it. The service clusters it at the first request for it
// (src/service/http/page/knot.rs); cuts are made here.

import { Hierarchy } from "./hierarchy";
import { count, make } from "./dom";
import { Level } from "./level";
import { scene } from "./load";
import { Coloured } from "./shown";
import type { View } from "./view";

/** Clusters that are shown at first, and the most. */
const [FIRST, MOST] = [240, 5000];

export class Visit {
  private view: View | null = null;
  private readonly abort = new AbortController();

  constructor(private readonly box: HTMLElement) {}

  /** Shows the knot; where the service has none, the sentence alone. */
  async run(): Promise<void> {
    const figure = make("div", { id: "knot", class: "view" });
    const told = make("p", { class: "cut" });
    const head = make(
      "header",
      { class: "head" },
      make("h2", {}, "Any surface, in any number of patches"),
      make("p", {}, "Drop a mesh or an image, or take a sample. Nothing leaves this service."),
      told,
    );
    const dock = make("div", { id: "dock" });
    this.box.replaceChildren(figure, head, dock);
    const { signal } = this.abort;
    const get = async (name: string): Promise<ArrayBuffer | null> => {
      const response = await fetch(name, { signal });
      return response.ok ? await response.arrayBuffer() : null;
    };
    const [glb, tsr, drawing] = await Promise.all([get("knot.glb"), get("knot.tsr"), scene()]);
    if (!glb || !tsr || signal.aborted) return;
    const mesh = await drawing.triangles(glb);
    const hierarchy = await Hierarchy.read({ bytes: (length) => Promise.resolve(tsr.slice(0, length)) });
    const coloured = new Coloured();
    coloured.setMesh(mesh);
    const view = new drawing.View(figure, mesh);
    this.view = view;
    // so that the words are beside it
    view.rig.room = 1.24;
    view.setUp(view.guessedUp);
    view.canvas.setAttribute("role", "img");
    view.canvas.setAttribute("aria-label", "A knot in clusters. Arrow keys turn it.");
    let [wanted, pending] = [FIRST, 0];
    const show = (): void => {
      pending = 0;
      coloured.set(hierarchy.cut(wanted).numbers);
      view.show(coloured.shown(null));
      figure.dataset["clusters"] = String(wanted);
      told.textContent = `${wanted === 1 ? "1 cluster" : `${count(wanted)} clusters`} of ${count(hierarchy.faces)} faces`;
    };
    const level = new Level(Math.max(1, hierarchy.least), Math.min(MOST, hierarchy.faces), (clusters) => {
      wanted = clusters;
      pending ||= requestAnimationFrame(show);
    });
    level.set(FIRST);
    dock.replaceChildren(level.element);
    show();
    if (!matchMedia("(prefers-reduced-motion: reduce)").matches) view.turn();
  }

  close(): void {
    this.abort.abort();
    this.view?.dispose();
    this.box.replaceChildren();
  }
}
