// The selected cluster: a card at the pointer, and its numbers in the inspector.

import { count, digits, make, swatch } from "./dom";
import type { ClusterRow } from "./shown";
import type { Clusters } from "./table";

/** What is known of a cluster; the service's numbers come later than the page's own. */
export interface Picked {
  cluster: number;
  colour: string;
  facts: [string, string][];
}

export class Selection {
  readonly element = make("section", { id: "picked", "aria-label": "Selected cluster" });
  /** Follows the pointer over the view; at a click it stays, with a button. */
  readonly card = make("div", { id: "card", hidden: true });
  onDownload: () => void = () => {};
  private readonly download = make("button", { type: "button", onclick: () => this.onDownload() }, "Download this one");
  private readonly numbers = make("div");

  constructor(buttons: HTMLElement[]) {
    this.element.append(this.numbers, make("div", { class: "tools" }, ...buttons));
    this.show(null, false);
  }

  /** Writes the numbers of the selected cluster, or how to select one. */
  show(picked: Picked | null, isTree: boolean, noun = "cluster"): void {
    this.element.dataset["cluster"] = picked === null ? "" : String(picked.cluster);
    if (!picked) {
      const isTouched = matchMedia("(pointer: coarse)").matches;
      const [click, name, merges] = isTouched ? ["Tap", "tap", ""] : ["Click", "click", ", one with Shift merges it"];
      const tree = isTree ? ` A second ${name} splits it${merges}.` : "";
      this.numbers.replaceChildren(make("p", {}, `${click} a ${noun} to see its numbers.${tree}`));
      return;
    }
    const rows = picked.facts.map(([name, value]) => {
      const told = make("dd", {}, value);
      told.dataset["fact"] = name.toLowerCase();
      return make("div", {}, make("dt", {}, name), told);
    });
    this.numbers.replaceChildren(
      make("h3", {}, swatch(picked.colour), `${noun.charAt(0).toUpperCase()}${noun.slice(1)} ${picked.cluster}`),
      make("dl", { class: "facts" }, ...rows),
    );
  }

  /** Shows the card at a place of the view; one that stays is where the pointer can reach it. */
  pointAt(x: number, y: number, colour: string, title: string, text: string, stays = false): void {
    this.card.replaceChildren(make("strong", {}, swatch(colour), title), make("span", {}, text));
    if (stays) this.card.append(this.download);
    this.card.hidden = false;
    const [width, height] = [this.card.parentElement?.clientWidth ?? 0, this.card.parentElement?.clientHeight ?? 0];
    const { offsetWidth, offsetHeight } = this.card;
    const [before, after] = stays ? [2, 2] : [12, 16];
    const left = x + after + offsetWidth > width ? x - before - offsetWidth : x + after;
    const top = y + after + offsetHeight > height ? y - before - offsetHeight : y + after;
    this.card.style.transform = `translate(${Math.max(0, left)}px, ${Math.max(0, top)}px)`;
  }

  pointAway(): void {
    this.card.hidden = true;
  }
}

/** The numbers of a cluster, as far as they are known. */
export function factsOf(
  cluster: number,
  { faces, area, centres }: Clusters,
  hasMesh: boolean,
  row: ClusterRow | null,
): [string, string][] {
  const facts: [string, string][] = [["Faces", count(faces[cluster] ?? 0)]];
  if (hasMesh) facts.push(["Area", digits(area[cluster] ?? 0)]);
  if (row) {
    facts.push(["Neighbours", count(row.neighbours)]);
    // a closed mesh in one cluster has no border
    if (row.roundness !== null) facts.push(["Roundness", digits(row.roundness, 3)]);
    if (row.perimeter !== null) facts.push(["Perimeter", digits(row.perimeter)]);
    if (row.energy !== null) facts.push(["Energy", digits(row.energy)]);
  }
  const centre = Array.from(centres.slice(3 * cluster, 3 * cluster + 3), (x) => digits(x, 3)).join(", ");
  if (hasMesh) facts.push(["Centre", centre]);
  return facts;
}
