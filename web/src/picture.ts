// The picture of a result: the mesh once it is there, the labels of one or two jobs on it, the cluster under the pointer.

import * as address from "./address";
import { type Job, type Shape, output, request } from "./api";
import type { Place, Triangles } from "./drawable";
import { count, digits, make, save } from "./dom";
import { stem } from "./downloads";
import type { Scene } from "./load";
import type { Parting } from "./panes";
import { part } from "./part";
import type { Selection } from "./selection";
import { angleOf, titleOf } from "./shapes";
import { Coloured, type Rows } from "./shown";
import { keepThumbnail } from "./thumbnails";
import type { Tools } from "./tools";
import type { View } from "./view";

/** Clusters up to which the service's table is fetched for the pointer. */
const MOST_ROWS = 5000;

export class Picture {
  readonly element = make("div", { id: "view", class: "view" });
  readonly mine = new Coloured();
  readonly other = new Coloured();
  /** Called with a cluster that is clicked, of which job it is, and whether Shift was held. */
  onPick: (cluster: number | null, isOther: boolean, withShift: boolean) => void = () => {};
  mesh: Triangles | null = null;
  /** The shape of each cluster, where the energy is of shapes. */
  shapes: Shape[] = [];
  private view: View | null = null;
  private selected: number | null = null;
  /** The place whose card is shown. */
  private pointed: Place | null = null;
  /** The cluster whose card stays where it was clicked. */
  clicked: number | null = null;

  constructor(
    private readonly job: Job,
    private readonly scene: Scene,
    private readonly tools: Tools,
    private readonly selection: Selection,
    private readonly rows: Rows,
    private running: Coloured | null,
    private readonly signal: AbortSignal,
  ) {
    tools.onUp = (up) => this.view?.setUp(up);
  }

  /** Offers to draw a mesh that takes much memory. */
  offer(triangles: number, onTake: () => void): void {
    const text = `Show ${count(triangles)} triangles in 3D`;
    this.element.replaceChildren(make("button", { type: "button", onclick: onTake }, text));
  }

  /** The bytes of the mesh. */
  async fetch(clusters: number | null): Promise<ArrayBuffer> {
    return await this.bytes(output(this.job, "mesh", { format: "glb", colours: "none", clusters }));
  }

  /** Makes the view of a mesh; `show` draws it. */
  async open(bytes: Promise<ArrayBuffer>): Promise<void> {
    this.element.setAttribute("aria-busy", "true");
    const mesh = await this.scene.triangles(await bytes);
    this.signal.throwIfAborted();
    this.mesh = mesh;
    const { up } = address.read();
    const view = new this.scene.View(this.element, mesh, this.job.mesh.format, up);
    this.view = view;
    this.tools.setUp(up ?? view.guessedUp);
    view.canvas.setAttribute("role", "img");
    view.canvas.setAttribute(
      "aria-label",
      "The mesh with its clusters. Arrow keys turn it, plus and minus zoom, 0 resets. The table has the same clusters.",
    );
    view.onPick = (place, withShift) => this.pick(place, withShift);
    view.onHover = (place) => this.hover(place);
    for (const move of ["pointerdown", "wheel", "keydown"])
      view.canvas.addEventListener(move, () => this.pointAway(), { passive: true });
    this.element.removeAttribute("aria-busy");
    this.mine.setMesh(mesh, this.running);
    this.running = null;
    this.other.setMesh(mesh);
    if (this.other.labels.length > 0) this.mine.setBoth(this.mine.labels, this.other, this.other.labels);
    else this.mine.set(this.mine.labels);
  }

  /** Draws the labels of one or two jobs; the first has the given colours, or hues. */
  show(colours: Uint8Array | null, hasOther: boolean, parting: Parting): void {
    this.view?.show(this.mine.shown(colours), hasOther ? this.other.shown(null) : null, parting);
    this.element.dataset["clusters"] = String(this.mine.hues.length);
  }

  part(parting: number): void {
    this.view?.part(parting);
  }

  select(cluster: number | null, other: number | null): void {
    this.selected = cluster;
    if (cluster === null) this.pointAway();
    this.view?.select(cluster, other);
  }

  /** Turns a cluster to the viewer. */
  face(cluster: number): void {
    this.view?.face(this.mine.clusters.normals.subarray(3 * cluster, 3 * cluster + 3));
  }

  /** Draws over the mesh what the tools say: edges of the remesh, sharp edges, or nothing. */
  async showOver(clusters: number | null): Promise<void> {
    const { over } = this.tools;
    if (over === null || !this.mesh) return this.view?.setEdges(null);
    const edges =
      over === "remesh"
        ? await this.scene.edges(await this.bytes(output(this.job, "remesh", { format: "glb", clusters })))
        : this.scene.sharpEdges(this.mesh, angleOf(this.job) ?? 0);
    this.view?.setEdges(edges.segments, edges.centre);
    this.element.dataset["edges"] = String(edges.segments.length / 6);
  }

  /** Hands over one cluster as a file. */
  saveOne(cluster: number | null): void {
    if (this.mesh && cluster !== null)
      save(part(this.mesh, this.mine.labels, cluster), `${stem(this.job)}-cluster-${cluster}.obj`);
  }

  async save(): Promise<void> {
    if (this.view) save(await this.view.picture(), `${stem(this.job)}-${this.mine.hues.length}.png`);
  }

  /** Keeps a picture for the list when it is fine, not of two jobs or of a cluster, nor of numbers of clusters. */
  keepThumbnail(): void {
    if (!this.view) return;
    this.view.onSettled = (canvas) => {
      const { with: other, colours } = address.read();
      if (other === null && colours === null && this.selected === null) keepThumbnail(this.job.id, canvas);
    };
  }

  pointAway(): void {
    this.clicked = this.pointed = null;
    this.selection.pointAway();
  }

  close(): void {
    this.view?.dispose();
  }

  private clusterAt({ triangle, pane }: Place): number | null {
    const face = triangle === null ? null : (this.mesh?.faces?.[triangle] ?? triangle);
    return face === null ? null : ((pane === 1 ? this.other : this.mine).labels[face] ?? null);
  }

  private pick(place: Place, withShift: boolean): void {
    const cluster = this.clusterAt(place);
    this.onPick(cluster, place.pane === 1, withShift);
    if (cluster === null || place.pane === 1 || cluster !== this.selected) return;
    this.clicked = cluster;
    this.point(place, cluster);
  }

  private hover(place: Place | null): void {
    const cluster = place && this.clusterAt(place);
    const isOther = place?.pane === 1;
    this.view?.hover(isOther ? null : cluster, isOther ? cluster : null);
    this.element.style.cursor = cluster === null ? "" : "pointer";
    // the pointer may be on its way to the card that stays
    if (this.clicked !== null && (cluster === null || (cluster === this.clicked && !isOther))) return;
    this.pointAway();
    if (place && cluster !== null) this.point(place, cluster);
  }

  /** Shows the card of a cluster. */
  private point(place: Place, cluster: number): void {
    const isOther = place.pane === 1;
    const coloured = isOther ? this.other : this.mine;
    const { faces, area } = coloured.clusters;
    const facts = [`${count(faces[cluster] ?? 0)} faces`, `area ${digits(area[cluster] ?? 0, 3)}`];
    if (!isOther) {
      const [shape, row] = [this.shapes[cluster], this.rows.now?.[cluster]];
      if (shape) facts.unshift(titleOf(shape));
      // the pointer may rest, so numbers that come later are written here
      const again = (): void => void (this.rows.now?.[cluster] && this.pointed === place && this.point(place, cluster));
      if (row) facts.push(`${count(row.neighbours)} neighbours`);
      else if (faces.length <= MOST_ROWS || this.clicked !== null) this.rows.fetch().then(again, () => {});
    }
    this.pointed = place;
    const [title, stays] = [`Cluster ${cluster}`, this.clicked !== null];
    this.selection.pointAt(place.x, place.y, coloured.css(cluster), title, facts.join(" · "), stays);
  }

  private async bytes(path: string): Promise<ArrayBuffer> {
    return await (await request(path, { signal: this.signal })).arrayBuffer();
  }
}
