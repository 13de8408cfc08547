// The page without a job: the chosen file, or a knot that turns and a slider. The service clusters the knot when
// it starts (src/service/http/page/knot.rs); the page cuts its hierarchy.

import * as address from "./address";
import { Before } from "./before";
import { Hierarchy } from "./hierarchy";
import { count, make } from "./dom";
import { isImage } from "./kinds";
import { Level } from "./level";
import { scene } from "./load";
import { Coloured } from "./shown";
import type { View } from "./view";

/** Clusters that are shown at first, and the most. */
const [FIRST, MOST] = [240, 5000];

/** Time without a move of the slider after which the address has the number, in milliseconds. */
const REST = 80;

export class Visit {
  private view: View | null = null;
  private before: Before | null = null;
  private resting = 0;
  /** The frame in which the next cut is shown; 0 for none. */
  private pending = 0;
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
      make("p", {}, "Nothing leaves this service."),
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
    if (signal.aborted) return;
    const coloured = new Coloured();
    coloured.setMesh(mesh);
    const view = new drawing.View(figure, mesh);
    this.view = view;
    // so that the words are beside it
    view.rig.room = 1.24;
    view.setUp(view.guessedUp);
    view.canvas.setAttribute("role", "img");
    view.canvas.setAttribute("aria-label", "A knot in clusters. Arrow keys turn it.");
    const most = Math.min(MOST, hierarchy.faces);
    const least = Math.max(1, hierarchy.least);
    let wanted = Math.min(Math.max(address.read().clusters ?? FIRST, least), most);
    const show = (): void => {
      this.pending = 0;
      coloured.set(hierarchy.cut(wanted).numbers);
      view.show(coloured.shown(null));
      figure.dataset["clusters"] = String(wanted);
      told.textContent = `${wanted === 1 ? "1 cluster" : `${count(wanted)} clusters`} of ${count(hierarchy.faces)} faces`;
    };
    const level = new Level(least, most, (clusters) => {
      wanted = clusters;
      clearTimeout(this.resting);
      this.resting = window.setTimeout(() => address.amend({ clusters }), REST);
      // a turn takes a software renderer longer than a cut
      view.hold();
      this.pending ||= requestAnimationFrame(show);
    });
    level.set(wanted);
    dock.replaceChildren(level.element);
    show();
    if (!matchMedia("(prefers-reduced-motion: reduce)").matches) view.turn();
  }

  /** Shows what was chosen, in grey. */
  async preview(files: File[]): Promise<void> {
    const [file] = files;
    const stage = make("div", { id: "chosen" });
    const words = [make("h2", {}, file?.name ?? ""), make("p", {}, "Not clustered yet")];
    const head = make("header", { class: "head" }, ...words);
    this.box.replaceChildren(stage, head);
    const drawing = await scene();
    if (this.abort.signal.aborted) return;
    this.before = new Before(stage, drawing, isImage(file?.name ?? "") ? "image" : "mesh");
    await this.before.show(Promise.resolve(files));
  }

  close(): void {
    clearTimeout(this.resting);
    cancelAnimationFrame(this.pending);
    this.abort.abort();
    this.before?.close();
    this.view?.dispose();
    this.box.replaceChildren();
  }
}
