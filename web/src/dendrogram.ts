// The top of a hierarchy as a picture: its last 64 clusters and how they merge, heights by clusters left. The hierarchy
// is cut where the node that is chosen is a cluster. One node takes the focus, and arrow keys move it along the tree.

import { type Job, json, output } from "./api";
import { count, make } from "./dom";

/** Clusters at the bottom of the picture. */
const LEAVES = 64;

const [WIDTH, HEIGHT, MARGIN] = [640, 200, 8];
const SVG = "http://www.w3.org/2000/svg";

interface Merge {
  id: number;
  children: [number, number];
  clusters_left: number;
  faces: number;
}

/** A node of the picture: a merge, or a cluster at the bottom. */
interface Item {
  id: number;
  parent: Item | null;
  children: Item[];
  /** The largest cut that has it as a cluster, or for clusters at the bottom that of the bottom. */
  clusters: number;
  faces: number | null;
  x: number;
  element: SVGElement;
}

export class Dendrogram {
  readonly element: HTMLDetailsElement;
  /** Called when a node is chosen, with the cut at which it is a cluster. */
  onChoose: (node: number, clusters: number) => void = () => {};
  /** Called when the picture is there. */
  onShow: () => void = () => {};
  private readonly figure = make("div", { id: "dendrogram" });
  private readonly items = new Map<number, Item>();
  private readonly roots: Item[] = [];
  private readonly line = svg("path", { class: "cut" });
  private leaves = 1;

  constructor(job: Job, signal: AbortSignal) {
    this.element = make("details", {}, make("summary", {}, `The last ${LEAVES} clusters as a tree`), this.figure);
    this.element.addEventListener("toggle", () => {
      if (!this.element.open || this.figure.hasChildNodes()) return;
      // a merge that leaves 63 clusters had 64 before it
      const path = output(job, "hierarchy", { format: "json", max_clusters: LEAVES - 1 });
      json<{ nodes: Merge[]; roots: number[] }>(path, { signal })
        .then(({ nodes, roots }) => {
          this.draw(nodes, roots);
          this.onShow();
        })
        .catch((error: unknown) => this.figure.replaceChildren(error instanceof Error ? error.message : String(error)));
    });
  }

  /** Whether the clusters of a cut are nodes of the picture. */
  has(clusters: number): boolean {
    return this.items.size > 0 && clusters <= this.leaves;
  }

  /** Draws the line of a cut, and marks a node. */
  mark(clusters: number, node: number | null): void {
    // between the merge that leaves so many clusters and the next one
    const at = clusters > this.leaves ? HEIGHT - 2 : Math.max(2, this.height(clusters - 0.5));
    this.line.setAttribute("d", `M0 ${at}H${WIDTH}`);
    for (const { id, element } of this.items.values()) element.setAttribute("aria-selected", String(id === node));
  }

  private draw(merges: Merge[], roots: number[]): void {
    const byId = new Map(merges.map((merge) => [merge.id, merge]));
    const bottom: Item[] = [];
    const stack = roots.map((id): [number, Item | null] => [id, null]).reverse();
    // parents before children, left before right
    for (let next = stack.pop(); next; next = stack.pop()) {
      const [id, parent] = next;
      const merge = byId.get(id);
      const element = svg("g", { role: "treeitem", tabindex: "-1" });
      const item: Item = { id, parent, children: [], clusters: merge?.clusters_left ?? 0, faces: null, x: 0, element };
      item.faces = merge?.faces ?? null;
      this.items.set(id, item);
      (parent?.children ?? this.roots).push(item);
      element.setAttribute("aria-level", String(Number(parent?.element.getAttribute("aria-level") ?? 0) + 1));
      if (merge) stack.push([merge.children[1], item], [merge.children[0], item]);
      else bottom.push(item);
    }
    this.leaves = bottom.length;
    for (const [i, leaf] of bottom.entries()) {
      leaf.x = MARGIN + ((i + 0.5) * (WIDTH - 2 * MARGIN)) / bottom.length;
      leaf.clusters = bottom.length;
    }
    // children come before parents
    for (const { id } of merges) {
      const item = this.items.get(id);
      if (item) item.x = item.children.reduce((sum, child) => sum + child.x, 0) / item.children.length;
    }
    const picture = svg("svg", {
      viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
      role: "tree",
      "aria-label": `${bottom.length} clusters and ${merges.length} merges of them`,
    });
    picture.append(this.line);
    for (const item of this.items.values()) picture.append(this.finish(item));
    this.roots[0]?.element.setAttribute("tabindex", "0");
    this.figure.replaceChildren(picture);
  }

  /** Gives an element its lines, its name and its keys. */
  private finish(item: Item): SVGElement {
    const { element, children, id, clusters, faces, x } = item;
    const top = this.top(item);
    const [a, b] = [children[0], children[1]];
    const lines = a && b ? `M${a.x} ${this.top(a)}V${top}H${b.x}V${this.top(b)}` : `M${x - 2} ${top}h4v4h-4z`;
    const text = faces === null ? `one of ${clusters} clusters` : `${count(faces)} faces, ${clusters} clusters left`;
    const title = svg("title", {});
    title.textContent = text;
    element.setAttribute("aria-label", text);
    element.append(svg("path", { d: lines, class: "reach" }), svg("path", { d: lines }), title);
    element.addEventListener("click", () => {
      this.focus(item);
      this.onChoose(id, clusters);
    });
    element.addEventListener("keydown", (event) => this.key(event, item));
    return element;
  }

  private key(event: KeyboardEvent, item: Item): void {
    const siblings = item.parent?.children ?? this.roots;
    const at = siblings.indexOf(item);
    const targets: Record<string, Item | null | undefined> = {
      ArrowUp: item.parent,
      ArrowDown: item.children[0],
      ArrowLeft: siblings[at - 1],
      ArrowRight: siblings[at + 1],
      Home: this.roots[0],
    };
    if (event.key === "Enter" || event.key === " ") this.onChoose(item.id, item.clusters);
    else if (!(event.key in targets)) return;
    event.preventDefault();
    const target = targets[event.key];
    if (target) this.focus(target);
  }

  private focus({ element }: Item): void {
    for (const other of this.items.values()) other.element.setAttribute("tabindex", "-1");
    element.setAttribute("tabindex", "0");
    element.focus();
  }

  private top(item: Item): number {
    return item.children.length === 0 ? HEIGHT - MARGIN : this.height(item.clusters);
  }

  private height(clusters: number): number {
    return MARGIN + ((HEIGHT - 2 * MARGIN) * Math.log(clusters)) / (Math.log(this.leaves) || 1);
  }
}

function svg(tag: string, attributes: Record<string, string>): SVGElement {
  const element = document.createElementNS(SVG, tag) as SVGElement;
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}
