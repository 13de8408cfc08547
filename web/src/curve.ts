// Energies as a curve: against iterations with a colour a phase, or of hierarchies against clusters. At most one redraw
// a frame. Logarithmic axes are linear ones of logarithms, which have marks within a decade too.

import uPlot from "uplot";

import type { IterationRow, RoundRow } from "./api";
import { digits, make } from "./dom";
import { wordOf } from "./words";

/** Phases that move faces, and at the end all that move or replace whole clusters. */
const SERIES = ["boundary", "refine", "repair", "regrow", "clusters"];
const STROKES = ["#2f7ed8", "#1a9850", "#d95f02", "#8e5bd0", "#0b8a8f"];
const seriesOf = (phase: string): number => (SERIES.includes(phase) ? SERIES.indexOf(phase) : SERIES.length - 1);
const HEIGHT = 150;

/** Logarithms of energies with marks: round ones, or powers of ten where they are more than a hundredfold. */
function marks(low: number, high: number): number[] {
  const isWide = high - low > 2;
  const [from, to] = isWide ? [low, high] : [10 ** low, 10 ** high];
  // four digits do not tell more apart
  if (to - from < 1e-3 * Math.abs(to)) return [(low + high) / 2];
  const least = (to - from) / 5;
  const power = 10 ** Math.floor(Math.log10(least));
  const step = Math.max(isWide ? 1 : 0, [1, 2, 5, 10].map((by) => by * power).find((by) => by >= least) ?? power);
  const places: number[] = [];
  for (let i = Math.ceil(from / step); i * step <= to; i++) places.push(isWide ? i * step : Math.log10(i * step));
  return places;
}

export class Curve {
  /** What each colour stands for, of the phases that there are. */
  readonly key = make("p", { class: "key" });
  private x: number[] = [];
  private readonly y: (number | null)[][] = SERIES.map(() => []);
  private previous: string | null = null;
  private plot: uPlot | null = null;
  private pending = 0;
  private readonly observer: ResizeObserver;
  private readonly scheme = matchMedia("(prefers-color-scheme: dark)");
  private readonly rebuild = (): void => this.reset();

  /** `isOfClusters`: of a hierarchy, whose iterations are not drawn. */
  constructor(
    private readonly box: HTMLElement,
    private readonly isOfClusters: boolean,
  ) {
    box.setAttribute("role", "img");
    this.observer = new ResizeObserver(() => this.plot?.setSize({ width: box.clientWidth, height: HEIGHT }));
    this.observer.observe(box);
    this.scheme.addEventListener("change", this.rebuild);
    this.clear();
  }

  /** Number of points. */
  get length(): number {
    return this.x.length;
  }

  clear(): void {
    this.x = [];
    for (const series of this.y) series.length = 0;
    this.previous = null;
    this.key.replaceChildren(...(this.isOfClusters ? ["from many clusters to few, in equal factors"] : []));
    this.box.setAttribute("aria-label", "No energies yet");
    delete this.box.dataset["points"];
    this.reset();
  }

  iteration(row: IterationRow): void {
    if (this.isOfClusters) return;
    this.add(this.x.length, row.energy, row.phase);
    this.name(seriesOf(row.phase));
    // the curve of a phase begins where that of the one before ends
    if (this.previous !== null && seriesOf(this.previous) !== seriesOf(row.phase)) {
      const at = this.x.length - 2;
      const last = this.y[seriesOf(this.previous)]?.[at];
      const series = this.y[seriesOf(row.phase)];
      if (series && last !== undefined) series[at] = last;
    }
    this.previous = row.phase;
    this.tell(
      `Energy ${row.energy === null ? "unknown" : digits(row.energy)} after iteration ${row.iteration}, ${wordOf(row.phase)}`,
    );
  }

  round(row: RoundRow): void {
    this.add(Math.log10(row.clusters), row.energy, "boundary");
    this.tell(`Energy ${row.energy === null ? "unknown" : digits(row.energy)} at ${row.clusters} clusters`);
  }

  dispose(): void {
    cancelAnimationFrame(this.pending);
    this.observer.disconnect();
    this.scheme.removeEventListener("change", this.rebuild);
    this.plot?.destroy();
  }

  private add(x: number, energy: number | null, phase: string): void {
    this.x.push(x);
    const shown = energy !== null && energy > 0 ? Math.log10(energy) : null;
    for (const [i, series] of this.y.entries()) series.push(i === seriesOf(phase) ? shown : null);
    this.pending ||= requestAnimationFrame(() => {
      this.pending = 0;
      this.plot?.setData(this.data());
    });
  }

  private name(series: number): void {
    const name = wordOf(SERIES[series] ?? "");
    if ([...this.key.children].some((phase) => phase.textContent === name)) return;
    const line = make("span", { class: "stroke" });
    line.style.background = STROKES[series] ?? "";
    this.key.append(make("span", {}, line, name));
  }

  private tell(text: string): void {
    this.box.setAttribute("aria-label", text);
    this.box.dataset["points"] = String(this.x.length);
  }

  private data(): uPlot.AlignedData {
    if (!this.isOfClusters) return [this.x, ...this.y];
    // uPlot takes rising abscissae only; clusters fall from round to round
    return [this.x.toReversed(), ...this.y.map((series) => series.toReversed())];
  }

  private reset(): void {
    this.plot?.destroy();
    const style = getComputedStyle(this.box);
    const axis = {
      stroke: style.color,
      grid: { stroke: style.borderColor, width: 1 },
      ticks: { stroke: style.borderColor, width: 1 },
    };
    const xs = { label: this.isOfClusters ? "clusters" : "iterations", labelSize: 18, size: 34 };
    this.plot = new uPlot(
      {
        width: this.box.clientWidth || 300,
        height: HEIGHT,
        legend: { show: false },
        cursor: { show: false },
        scales: { x: { time: false, dir: this.isOfClusters ? -1 : 1 } },
        axes: [
          {
            ...axis,
            ...xs,
            // whole iterations, whole decades of clusters
            incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000],
            values: (_, splits) => splits.map((x) => (this.isOfClusters ? digits(10 ** x) : String(x))),
          },
          {
            ...axis,
            size: 80,
            splits: (_, __, low, high) => marks(low, high),
            values: (_, splits) => splits.map((y) => digits(10 ** y)),
          },
        ],
        series: [
          {},
          ...SERIES.map((name, i) => ({ label: name, stroke: STROKES[i] ?? "", width: 2, points: { show: false } })),
        ],
      },
      this.data(),
      this.box,
    );
  }
}
