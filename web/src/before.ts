// The mesh or the image of a job that has not ended, then with the clusters that the run has at the moment.

import type { LabelsEvent } from "./api";
import { make } from "./dom";
import type { Shown } from "./drawable";
import type { Scene } from "./load";
import { pixelsOf } from "./photo";
import { Coloured, numbered } from "./shown";

/** What draws a mesh or an image. */
interface Drawing {
  canvas: HTMLCanvasElement;
  /** Triangles or pixels. */
  items: number;
  show(shown: Shown): void;
  dispose(): void;
}

export class Before {
  private readonly figure: HTMLElement;
  private drawing: Drawing | null = null;
  private labels = new Uint32Array();
  /** Clusters of the run in hues, with which those of the result go on. */
  readonly coloured = new Coloured();
  private shown = 0;

  constructor(
    stage: HTMLElement,
    private readonly scene: Scene,
    private readonly kind: "mesh" | "image",
  ) {
    this.figure = make("div", { class: "view", id: "preview" }, `Reading the ${kind}`);
    stage.replaceChildren(this.figure);
  }

  /** Shows the mesh or the image, or says why not. */
  async show(files: Promise<File[]>): Promise<void> {
    let open: () => Drawing;
    try {
      const all = await files;
      open = await (this.kind === "image" ? this.image(all) : this.mesh(all));
    } catch (error) {
      const why = error instanceof Error ? error.message : String(error);
      this.figure.textContent = `The page cannot draw this file by itself: ${why}.`;
      return;
    }
    if (!this.figure.isConnected) return;
    this.drawing = open();
    this.drawing.canvas.setAttribute("role", "img");
    this.drawing.canvas.setAttribute("aria-label", `The ${this.kind}, not yet clustered`);
    this.draw();
  }

  private async mesh(files: File[]): Promise<() => Drawing> {
    const mesh = await this.scene.preview(files);
    this.coloured.setMesh(mesh);
    const format = /[^.]*$/.exec(files[0]?.name ?? "")?.[0].toLowerCase();
    return () => new this.scene.View(this.figure, mesh, format);
  }

  private async image([file]: File[]): Promise<() => Drawing> {
    if (!file) throw new Error("it is not here");
    const image = await pixelsOf(file);
    return () => {
      const plane = new this.scene.Plane(this.figure, image);
      const show = (shown: Shown | null): void => plane.show(image, shown, "photo");
      show(null);
      const dispose = (): void => {
        plane.dispose();
        image.close();
      };
      return { canvas: plane.canvas, items: image.width * image.height, show, dispose };
    };
  }

  /** Takes labels of the run. */
  take({ faces, changes }: LabelsEvent): void {
    if (this.labels.length !== faces) this.labels = new Uint32Array(faces);
    const bytes = Uint8Array.from(atob(changes), (character) => character.charCodeAt(0));
    const pairs = new Uint32Array(bytes.buffer);
    for (let i = 0; i < pairs.length; i += 2) this.labels[pairs[i] ?? 0] = pairs[i + 1] ?? 0;
    this.draw();
  }

  close(): void {
    this.drawing?.dispose();
  }

  /** Polygons are other triangles here than in the service, so only a mesh of triangles has colours. */
  private draw(): void {
    if (!this.drawing || this.labels.length === 0 || this.drawing.items !== this.labels.length) return;
    this.coloured.set(numbered(this.labels));
    this.drawing.canvas.setAttribute("aria-label", `The ${this.kind} with the clusters of the run`);
    this.drawing.show(this.coloured.shown(null));
    this.figure.dataset["shown"] = String(++this.shown);
  }
}
