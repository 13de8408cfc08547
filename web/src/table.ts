// The clusters as a table: what the 3D view shows, for readers of screens and keyboards. A page of rows at a time.

import { count, digits, make, swatch } from "./dom";
import type { Triangles } from "./drawable";

/** Rows on a page. */
const ROWS = 20;

/** Size and place of each cluster. */
export interface Clusters {
  faces: Uint32Array;
  area: Float64Array;
  /** Mean of the centres of its triangles, weighted by area; three numbers each. */
  centres: Float64Array;
  /** Sum of the normals of its triangles, as long as twice their areas; three numbers each. */
  normals: Float64Array;
}

/** Adds up what each cluster has. */
export function measure(labels: Uint32Array, mesh: Triangles | null): Clusters {
  const clusters = labels.reduce((most, label) => Math.max(most, label + 1), 0);
  const faces = new Uint32Array(clusters);
  for (const label of labels) faces[label] = (faces[label] ?? 0) + 1;
  const area = new Float64Array(clusters);
  const [centres, normals] = [new Float64Array(3 * clusters), new Float64Array(3 * clusters)];
  if (!mesh) return { faces, area, centres, normals };
  const p = mesh.positions;
  const at = (i: number): number => p[i] ?? 0;
  // plain variables: millions of triangles
  for (let t = 0, i = 0; i < p.length; t++, i += 9) {
    const label = labels[mesh.faces ? (mesh.faces[t] ?? 0) : t] ?? 0;
    const ux = at(i + 3) - at(i);
    const uy = at(i + 4) - at(i + 1);
    const uz = at(i + 5) - at(i + 2);
    const vx = at(i + 6) - at(i);
    const vy = at(i + 7) - at(i + 1);
    const vz = at(i + 8) - at(i + 2);
    const x = uy * vz - uz * vy;
    const y = uz * vx - ux * vz;
    const z = ux * vy - uy * vx;
    const size = Math.sqrt(x * x + y * y + z * z) / 2;
    area[label] = (area[label] ?? 0) + size;
    normals[3 * label] = (normals[3 * label] ?? 0) + x;
    normals[3 * label + 1] = (normals[3 * label + 1] ?? 0) + y;
    normals[3 * label + 2] = (normals[3 * label + 2] ?? 0) + z;
    for (let axis = 0; axis < 3; axis++) {
      const centre = (at(i + axis) + at(i + 3 + axis) + at(i + 6 + axis)) / 3;
      centres[3 * label + axis] = (centres[3 * label + axis] ?? 0) + size * centre;
    }
  }
  const offset = mesh.centre.toArray();
  for (let i = 0; i < centres.length; i++) {
    centres[i] = (centres[i] ?? 0) / (area[Math.floor(i / 3)] || 1) + (offset[i % 3] ?? 0);
  }
  return { faces, area, centres, normals };
}

export class ClusterTable {
  onSelect: (cluster: number) => void = () => {};
  private columns: ArrayLike<number>[] = [];
  /** The number of the column that rows are ordered by, or -1 for the clusters. */
  private order = -1;
  private rows: number[] = [];
  private page = 0;
  private selected: number | null = null;
  private readonly body = make("tbody");
  private readonly where = make("span");

  constructor(
    box: HTMLElement,
    private readonly colour: (cluster: number) => string,
    /** What each column has; the first has a number a cluster. */
    names: string[],
  ) {
    const order = make("select", { id: "order", onchange: () => this.sort(order.selectedIndex - 1) });
    for (const name of ["cluster", ...names]) order.append(make("option", { value: name }, name));
    const titles = ["cluster", ...names].map((name) => name.charAt(0).toUpperCase() + name.slice(1));
    const turn = (by: number): void => this.turn(by);
    box.append(
      make(
        "div",
        { class: "tools" },
        make("label", { for: "order" }, "Order"),
        order,
        make("button", { type: "button", onclick: () => turn(-1) }, "Previous"),
        this.where,
        make("button", { type: "button", onclick: () => turn(1) }, "Next"),
      ),
      make(
        "table",
        { id: "cluster-table" },
        make("caption", { class: "hidden-text" }, "Clusters"),
        make("thead", {}, make("tr", {}, ...titles.map((name) => make("th", { scope: "col" }, name)))),
        this.body,
      ),
    );
  }

  show(columns: ArrayLike<number>[]): void {
    this.columns = columns;
    this.sort(this.order);
  }

  /** Marks a row and turns to its page. */
  select(cluster: number | null): void {
    this.selected = cluster;
    const row = cluster === null ? -1 : this.rows.indexOf(cluster);
    if (row >= 0) this.page = Math.floor(row / ROWS);
    this.draw();
  }

  private sort(order: number): void {
    this.order = order;
    this.rows = Array.from({ length: this.columns[0]?.length ?? 0 }, (_, cluster) => cluster);
    const of = this.columns[order];
    if (of) this.rows.sort((a, b) => (of[b] ?? 0) - (of[a] ?? 0) || a - b);
    this.page = 0;
    this.draw();
  }

  private turn(by: number): void {
    this.page = Math.max(0, Math.min(this.page + by, Math.ceil(this.rows.length / ROWS) - 1));
    this.draw();
  }

  private draw(): void {
    const first = this.page * ROWS;
    const shown = this.rows.slice(first, first + ROWS);
    this.where.textContent = `${count(first + 1)} to ${count(first + shown.length)} of ${count(this.rows.length)}`;
    this.body.replaceChildren(
      ...shown.map((cluster) => {
        const pressed = String(cluster === this.selected);
        const attributes = { type: "button", "aria-pressed": pressed, onclick: () => this.onSelect(cluster) };
        const button = make("button", attributes, swatch(this.colour(cluster)), `cluster ${cluster}`);
        const cells = this.columns.map((column, i) => {
          const number = column[cluster] ?? NaN;
          return make("td", {}, i === 0 ? count(number) : Number.isNaN(number) ? "" : digits(number));
        });
        return make("tr", {}, make("th", { scope: "row" }, button), ...cells);
      }),
    );
  }
}
