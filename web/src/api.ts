// The service's interface. The token lives in sessionStorage and travels in a header, never in an address.

import { notice } from "./dom";
import { kindOf } from "./kinds";
import * as storage from "./storage";

export type State = "queued" | "running" | "succeeded" | "failed" | "cancelled";

export interface Problem {
  title: string;
  detail: string;
}

export interface Job {
  id: string;
  state: State;
  queue_position: number | null;
  attempt: number;
  progress: { iterations: number; phase: string | null; clusters_left: number | null; energy: number | null };
  problem: Problem | null;
  result: { faces: number; clusters: number } | null;
  parameters: { algorithm: string; clusters?: number | null; quality?: string | null; [name: string]: unknown };
  mesh: { file_name: string | null; format: string; bytes: number; buffers: string[] };
  created_at: string;
  started_at: string | null;
  ended_at: string | null;
  /** Files that were named in the request. */
  outputs: string[];
  keep_mesh: boolean;
  urls: Record<string, string | null>;
}

/** What a report has of a mesh, and what it has of points. */
type Input = { faces: number; triangles: number } & Partial<PointsInput>;
interface PointsInput {
  items: number;
  masked: number;
  dimensions: number;
  shape: number[];
  edges: number;
  graph: string;
}

/** A row of the report's `shapes`: the member that the type names has its parameters. Lengths are in units of the file. */
export interface Shape {
  type: string;
  residual: { rms: number; max: number };
  torus?: { major_radius: number; minor_radius: number } | null;
  [type: string]: unknown;
}

export interface Report {
  input: Input;
  /** Of energies of shapes: a row a label. */
  shapes?: Shape[] | null;
  clusters: number | null;
  energy: { initial: number | null; final: number | null; hexagon_ratio: number | null; explained?: number | null };
  timings_ms: Record<string, number>;
  warnings: string[];
}

export interface IterationRow {
  iteration: number;
  phase: string;
  energy: number | null;
}

export interface RoundRow {
  round: number;
  clusters: number;
  energy: number | null;
}

/** Labels of a running job: of each face that changed, the face and its label, 32 bits each, in base64. */
export interface LabelsEvent {
  faces: number;
  changes: string;
}

export type JobEvent =
  | { name: "state"; data: { state: State; attempt?: number } }
  | { name: "iteration"; data: IterationRow }
  | { name: "round"; data: RoundRow }
  | { name: "labels"; data: LabelsEvent }
  | { name: "end"; data: { state: State; problem: Problem | null } };

/** An answer that is no success. */
export class Refused extends Error {
  constructor(
    readonly status: number,
    message: string,
    /** Seconds after which the service would have it again, where it says so. */
    readonly retryAfter: number | null = null,
  ) {
    super(message);
  }
}

/** What the page says while requests get no answer. */
export const GONE = "The service does not answer. The page goes on when it is back.";

const TOKEN = "tesserae-token";

export const token = {
  get: (): string => storage.get(TOKEN) ?? "",
  set: (text: string): void => (text === "" ? storage.remove(TOKEN) : storage.set(TOKEN, text)),
};

/** Least difference of two clocks that is one: answers have their time in seconds. */
const AHEAD_MS = 2000;
let ahead = 0;

/** The time by the service's clock. */
export const now = (): number => Date.now() + ahead;

export const isLive = (job: Job): boolean => job.state === "queued" || job.state === "running";
export const isHierarchical = (algorithm: string): boolean => ["pml", "ml", "hr"].includes(algorithm);
export const nameOf = (job: Job): string => job.mesh.file_name ?? `${kindOf(job)}.${job.mesh.format}`;

/** Clusters that a hierarchy is shown at first. */
const FIRST_CUT = 100;

/** The number of clusters that a job is shown at first; null where it has one number. */
export function firstCut({ parameters, result }: Job): number | null {
  if (!isHierarchical(parameters.algorithm)) return null;
  const { clusters: least = 1, faces: most = 1 } = result ?? {};
  const asked = parameters.clusters ?? (parameters["levels"] as number[] | null)?.reduce((a, b) => Math.min(a, b));
  return Math.min(Math.max(least, asked ?? Math.min(FIRST_CUT, Math.floor(most / 4))), most);
}

/** Waits; an abort ends it with an error. */
export const pause = (ms: number, signal?: AbortSignal | null): Promise<void> =>
  new Promise((resolve, reject) => {
    const stop = (): void => {
      clearTimeout(timer);
      reject(signal?.reason as Error);
    };
    const timer = setTimeout(() => {
      signal?.removeEventListener("abort", stop);
      resolve();
    }, ms);
    signal?.addEventListener("abort", stop);
  });

/** What an answer that is no success says. */
export const refusal = (status: number, { detail, title }: Partial<Problem>, retryAfter: string | null): Refused =>
  new Refused(
    status,
    status === 401 ? wanted() : (detail ?? title ?? `the service answered ${status}`),
    retryAfter === null ? null : Number(retryAfter) || 1,
  );

/** The message of a 401. */
const wanted = (): string =>
  token.get() === "" ? "This service wants a token." : "The service does not know this token. Write another one.";

/** Says that the service has too much to do, and waits as long as it says; any other error is thrown again. */
export async function untilLater(error: unknown, signal?: AbortSignal | null): Promise<void> {
  if (!(error instanceof Refused) || error.status !== 429 || error.retryAfter === null) throw error;
  notice(`${error.message}. The page tries again in ${error.retryAfter} s.`);
  await pause(1000 * error.retryAfter, signal);
  notice("");
}

/**
 * A request with the token; an answer that is no success becomes a {@link Refused} with the detail of its problem. What
 * is too much for now (429) is repeated when the service says.
 */
export async function request(path: string, options: RequestInit = {}): Promise<Response> {
  const headers = new Headers(options.headers);
  const mine = token.get();
  if (mine !== "") headers.set("authorization", `Bearer ${mine}`);
  for (;;) {
    const response = await fetch(path, { ...options, headers });
    const difference = Date.parse(response.headers.get("date") ?? "") - Date.now();
    ahead = Math.abs(difference) > AHEAD_MS ? difference : 0;
    if (response.ok) return response;
    const problem = (await response.json().catch(() => ({}))) as Partial<Problem>;
    await untilLater(refusal(response.status, problem, response.headers.get("retry-after")), options.signal);
  }
}

export async function json<T>(path: string, options: RequestInit = {}): Promise<T> {
  const response = await request(path, options);
  return (await response.json()) as T;
}

/** Address of an output of a job. */
export function output(job: Job, name: string, query: Record<string, string | number | null> = {}): string {
  const given = Object.entries(query).filter(([, value]) => value !== null);
  const search = new URLSearchParams(given.map(([key, value]) => [key, String(value)]));
  return `/v1/jobs/${job.id}/${name}${search.size > 0 ? `?${search}` : ""}`;
}

export interface Labels {
  /** One a face, in upload order. */
  numbers: Uint32Array;
  /** Energy of a cut. */
  energy: number | null;
}

/** Labels; of a hierarchy at `clusters`. */
export async function labels(job: Job, clusters: number | null, signal: AbortSignal): Promise<Labels> {
  const response = await request(output(job, "labels", { format: "bin", clusters }), { signal });
  const energy = response.headers.get("tesserae-energy");
  return { numbers: new Uint32Array(await response.arrayBuffer()), energy: energy === null ? null : Number(energy) };
}

/** Bytes of an output, without its content; null where the service does not tell. */
export async function length(path: string, signal: AbortSignal): Promise<number | null> {
  const response = await request(path, { signal, headers: { range: "bytes=0-0" } });
  await response.body?.cancel();
  const total = /\/(\d+)$/.exec(response.headers.get("content-range") ?? "")?.[1];
  return total === undefined ? null : Number(total);
}

/**
 * Follows the events of a job, those after `last`, to their end; gives the number of the last one. A job that is run
 * again has events after an `end`, so the end is where the stream closes. A stream that breaks is resumed after the last
 * event, until the service is back. `onBreak` gets a text at every break, and an empty one when the stream goes on.
 */
export async function follow(
  id: string,
  last: string,
  signal: AbortSignal,
  onEvent: (event: JobEvent) => void,
  onBreak: (why: string) => void,
): Promise<string> {
  let isEnded = false;
  for (let wait = 250; !signal.aborted; wait = Math.min(2 * wait, 4000)) {
    try {
      const headers: Record<string, string> = { accept: "text/event-stream" };
      if (last !== "") headers["last-event-id"] = last;
      const response = await request(`/v1/jobs/${id}/events?labels=true`, { signal, headers });
      onBreak("");
      // it has ended, and there is no event that is not known
      if (response.status === 204) return last;
      for await (const event of events(response)) {
        wait = 250;
        if (event.id !== "") last = event.id;
        isEnded = event.name === "end";
        onEvent(event as unknown as JobEvent);
      }
      if (isEnded) return last;
    } catch (error) {
      if (signal.aborted) return last;
      // what the service refuses does not become right by repetition
      if (error instanceof Refused && error.status < 500) throw error;
    }
    onBreak(GONE);
    await pause(wait);
  }
  return last;
}

interface RawEvent {
  id: string;
  name: string;
  data: unknown;
}

/** The events of a stream (HTML Standard §9.2.6), of which the service writes one `data` line each. */
async function* events(response: Response): AsyncGenerator<RawEvent> {
  if (!response.body) return;
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    const blocks = (rest + value).split("\n\n");
    rest = blocks.pop() ?? "";
    for (const block of blocks) {
      const event: RawEvent = { id: "", name: "", data: null };
      for (const line of block.split("\n")) {
        const [field = "", text = ""] = split(line);
        if (field === "id") event.id = text;
        else if (field === "event") event.name = text;
        else if (field === "data") event.data = JSON.parse(text);
      }
      if (event.name !== "") yield event;
    }
  }
}

function split(line: string): string[] {
  const at = line.indexOf(":");
  return at < 0 ? [line] : [line.slice(0, at), line.slice(at + 1).replace(/^ /, "")];
}
