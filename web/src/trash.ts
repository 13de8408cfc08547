// Deletion with time to think again: a job is hidden at once, and deleted when the time is over or the page is left.

import { request } from "./api";
import { announce, byId, make, notice } from "./dom";

/** Time in which a deletion can be undone, in milliseconds. */
const TIME = 10_000;

interface Deletion {
  timer: number;
  onUndo: () => void;
}

const deletions = new Map<string, Deletion>();

export const isDeleted = (job: string): boolean => deletions.has(job);

export function remove(job: string, name: string, onChange: () => void, onUndo: () => void): void {
  const timer = window.setTimeout(() => void finish(job).then(onChange), TIME);
  deletions.set(job, { timer, onUndo });
  const undo = make("button", { type: "button", id: "undo" }, "Undo");
  undo.addEventListener("click", () => {
    clearTimeout(timer);
    deletions.delete(job);
    byId("toast").hidden = true;
    onUndo();
  });
  byId("toast").replaceChildren(make("span", {}, `${name} is deleted`), undo);
  byId("toast").hidden = false;
  announce(`${name} is deleted. Undo is possible for ten seconds.`);
}

async function finish(job: string): Promise<void> {
  if (!deletions.has(job)) return;
  try {
    // also when the page is left
    await request(`/v1/jobs/${job}`, { method: "DELETE", keepalive: true });
  } catch (error) {
    notice(error instanceof Error ? error.message : String(error));
  }
  deletions.delete(job);
  if (deletions.size === 0) byId("toast").hidden = true;
}

window.addEventListener("pagehide", () => {
  for (const job of deletions.keys()) void finish(job);
});
