// The top of a hierarchy as a picture: its last 64 clusters and how they merge, heights by clusters left.

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

export function dendrogram(job: Job, signal: AbortSignal): HTMLElement {
  const figure = make("div", { id: "dendrogram" });
  const box = make("details", {}, make("summary", {}, `The last ${LEAVES} clusters as a tree`), figure);
  box.addEventListener("toggle", () => {
    if (!box.open || figure.hasChildNodes()) return;
    // a merge that leaves 63 clusters had 64 before it
    json<{ nodes: Merge[]; roots: number[] }>(output(job, "hierarchy", { format: "json", max_clusters: LEAVES - 1 }), {
      signal,
    })
      .then(({ nodes, roots }) => figure.replaceChildren(picture(nodes, roots)))
      .catch((error: unknown) => figure.replaceChildren(error instanceof Error ? error.message : String(error)));
  });
  return box;
}

function picture(nodes: Merge[], roots: number[]): Element {
  const byId = new Map(nodes.map((node) => [node.id, node]));
  const leaves: number[] = [];
  const visit = (root: number): void => {
    const stack = [root];
    for (let id = stack.pop(); id !== undefined; id = stack.pop()) {
      const node = byId.get(id);
      if (node) stack.push(node.children[1], node.children[0]);
      else leaves.push(id);
    }
  };
  roots.forEach(visit);
  const x = new Map(leaves.map((id, i) => [id, MARGIN + ((i + 0.5) * (WIDTH - 2 * MARGIN)) / leaves.length]));
  const most = Math.log(leaves.length);
  const height = (id: number): number => {
    const left = byId.get(id)?.clusters_left;
    return left === undefined ? HEIGHT - MARGIN : MARGIN + ((HEIGHT - 2 * MARGIN) * Math.log(left)) / (most || 1);
  };
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", `${leaves.length} clusters and ${nodes.length} merges of them`);
  // children come before parents
  for (const { id, children, clusters_left: left, faces } of nodes) {
    const [a, b] = children.map((child) => x.get(child) ?? 0) as [number, number];
    x.set(id, (a + b) / 2);
    const path = document.createElementNS(SVG, "path");
    path.setAttribute("d", `M${a} ${height(children[0])}V${height(id)}H${b}V${height(children[1])}`);
    const title = document.createElementNS(SVG, "title");
    title.textContent = `${count(faces)} faces, ${left} clusters left`;
    path.append(title);
    svg.append(path);
  }
  return svg;
}
