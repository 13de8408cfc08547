// Deletion with time to think again: a job is hidden at once, and deleted when the time is over. Deletions outlive a
// reload, which begins their time anew. A tab that is closed deletes nothing.

import { Refused, request } from "./api";
import { byId, make, report } from "./dom";
import * as storage from "./storage";

/** Time in which a deletion can be undone, in milliseconds. */
const TIME = 10_000;

const KEY = "deletions";

interface Deletion {
  name: string;
  /** The address that an undo goes back to. */
  hash: string;
  /** Until when a reload offers the undo again, in milliseconds since 1970. */
  until: number;
}

const deletions = new Map<string, Deletion>();

export const isDeleted = (job: string): boolean => deletions.has(job);

export function remove(job: string, name: string, onChange: () => void): void {
  offer(job, name, location.hash, onChange);
}

/** Goes on with the deletions of before a reload; a tab that is opened again later has none. */
export function resume(onChange: () => void): void {
  const stored = JSON.parse(storage.get(KEY) ?? "[]") as [string, Deletion][];
  for (const [job, { name, hash, until }] of stored) if (Date.now() < until) offer(job, name, hash, onChange);
  // a copy of this tab has none
  addEventListener("pageshow", () => storage.remove(KEY));
  addEventListener("pagehide", () => deletions.size > 0 && storage.set(KEY, JSON.stringify([...deletions])));
}

/** Hides a job, and shows its deletion with an undo until the time is over. */
function offer(job: string, name: string, hash: string, onChange: () => void): void {
  const deletion = { name, hash, until: Date.now() + 2 * TIME };
  deletions.set(job, deletion);
  const toast = byId("toast");
  const end = (): void => {
    row.remove();
    toast.hidden = toast.childElementCount === 0;
    deletions.delete(job);
    onChange();
  };
  const timer = setTimeout(() => {
    deletion.until = 0;
    undo.disabled = true;
    void finish(job).then(end);
  }, TIME);
  const undo = make("button", { type: "button", class: "undo", "aria-label": `Undo the deletion of ${name}` }, "Undo");
  undo.addEventListener("click", () => {
    clearTimeout(timer);
    end();
    byId("main").focus({ preventScroll: true });
    if (location.hash === hash) dispatchEvent(new HashChangeEvent("hashchange"));
    else location.hash = hash;
  });
  const row = make("p", {}, make("span", {}, `${name} is deleted`), undo);
  toast.append(row);
  toast.hidden = false;
}

async function finish(job: string): Promise<void> {
  try {
    await request(`/v1/jobs/${job}`, { method: "DELETE", keepalive: true });
  } catch (error) {
    if (!(error instanceof Refused && error.status === 404)) report(error);
  }
}
