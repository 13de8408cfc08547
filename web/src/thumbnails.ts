// Small pictures of jobs for the list, of those that were shown and of images; they are gone with the session.

import { type Job, length, request } from "./api";
import { pixelsOf } from "./photo";

const SIDE = 88;

/** Names of pictures in the session begin with it. */
const PREFIX = "picture-";

/** Bytes above which the means of an image are not fetched for the list. */
const MOST_BYTES = 2e6;

/** Jobs whose picture was fetched, or cannot be. */
const asked = new Set<string>();
let fetching: Promise<void> = Promise.resolve();

/** Keeps the middle of a picture as that of a job; of a canvas, one that was drawn just now. */
export function keepThumbnail(job: string, picture: HTMLCanvasElement | ImageBitmap): void {
  const small = document.createElement("canvas");
  small.width = small.height = SIDE;
  const side = Math.min(picture.width, picture.height);
  const [x, y] = [(picture.width - side) / 2, (picture.height - side) / 2];
  const context = small.getContext("2d");
  if (context) context.imageSmoothingQuality = "high";
  context?.drawImage(picture, x, y, side, side, 0, 0, SIDE, SIDE);
  const keep = (): void => sessionStorage.setItem(PREFIX + job, small.toDataURL("image/webp"));
  try {
    keep();
  } catch {
    // there is no room
    for (const key of Object.keys(sessionStorage)) if (key.startsWith(PREFIX)) sessionStorage.removeItem(key);
    try {
      keep();
    } catch {
      // others have taken all room
    }
  }
}

export const thumbnail = (job: string): string | null => sessionStorage.getItem(PREFIX + job);

/** Fetches the mean colours of images that have no picture yet, one after the other. */
export function fetchThumbnails(jobs: Job[]): void {
  for (const { id, state, urls } of jobs) {
    const path = urls["means"];
    if (state !== "succeeded" || !path || asked.has(id) || thumbnail(id)) continue;
    asked.add(id);
    fetching = fetching.then(() => fetchOne(id, path)).catch(() => {});
  }
}

async function fetchOne(id: string, path: string): Promise<void> {
  const { signal } = new AbortController();
  const bytes = await length(path, signal);
  if (thumbnail(id) || bytes === null || bytes > MOST_BYTES) return;
  const means = await pixelsOf(await (await request(path, { signal })).blob());
  keepThumbnail(id, means);
  means.close();
}
