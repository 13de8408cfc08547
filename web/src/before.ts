// The mesh of a job that has not ended: in grey, then in the clusters that the run has at the moment.

import type { LabelsEvent } from "./api";
import { make } from "./dom";
import type { Triangles } from "./drawable";
import type { Scene } from "./load";
import { HUES, ofHues } from "./palette";
import type { View } from "./view";

export class Before {
  private readonly figure = make("div", { class: "view", id: "preview" }, "Reading the mesh");
  private view: View | null = null;
  private labels = new Uint32Array();
  private colours: Uint8Array = new Uint8Array();
  private shown = 0;

  constructor(
    stage: HTMLElement,
    private readonly scene: Scene,
  ) {
    stage.replaceChildren(this.figure);
  }

  /** Shows the mesh, or says why not. */
  async show(files: Promise<File[]>): Promise<void> {
    let mesh: Triangles;
    let name = "";
    try {
      const all = await files;
      name = all[0]?.name ?? "";
      mesh = await this.scene.preview(all);
    } catch (error) {
      const why = error instanceof Error ? error.message : String(error);
      this.figure.textContent = `The mesh is shown when it is clustered, not before: ${why}.`;
      return;
    }
    if (!this.figure.isConnected) return;
    this.view = new this.scene.View(this.figure, mesh, /[^.]*$/.exec(name)?.[0].toLowerCase());
    this.view.canvas.setAttribute("role", "img");
    this.view.canvas.setAttribute("aria-label", "The mesh, not yet clustered");
    this.draw();
  }

  /** Takes labels of the run. */
  take({ faces, changes }: LabelsEvent): void {
    if (this.labels.length !== faces) {
      this.labels = new Uint32Array(faces);
      // labels are below the number of faces
      this.colours = ofHues(Uint8Array.from(this.labels, (_, label) => label % HUES.length));
    }
    const bytes = Uint8Array.from(atob(changes), (character) => character.charCodeAt(0));
    const pairs = new Uint32Array(bytes.buffer);
    for (let i = 0; i < pairs.length; i += 2) this.labels[pairs[i] ?? 0] = pairs[i + 1] ?? 0;
    this.draw();
  }

  close(): void {
    this.view?.dispose();
  }

  /** Polygons are other triangles here than in the service, so only a mesh of triangles has colours. */
  private draw(): void {
    if (!this.view || this.labels.length === 0 || this.view.triangles !== this.labels.length) return;
    this.view.show({ labels: this.labels, colours: this.colours });
    this.figure.dataset["shown"] = String(++this.shown);
  }
}
