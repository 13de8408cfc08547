// Small pictures of jobs for the list, in hues, light or dark as the page is. Those of jobs that were not opened are
// made while the page has nothing else to do: of meshes in a view that is not seen, of images from their mean colours.

import * as address from "./address";
import { type Job, firstCut, labels, length, output, request } from "./api";
import { make } from "./dom";
import { kindOf } from "./kinds";
import { scene } from "./load";
import { pixelsOf } from "./photo";
import { Coloured } from "./shown";
import * as storage from "./storage";

const SIDE = 88;

/** Bytes above which the means of an image are not fetched for the list, and faces above which a mesh is not. */
const [MOST_BYTES, MOST_FACES] = [2e6, 300_000];

/** For how long a picture is waited for. */
const PATIENCE_MS = 60_000;

/** Names of pictures that were made, or cannot be. */
const asked = new Set<string>();
let making: Promise<void> = Promise.resolve();

const nameOf = (job: string): string =>
  `${storage.PICTURE}${matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"}-${job}`;

/** Keeps the middle of a picture as that of a job; of a canvas, one that was drawn just now. */
export function keepThumbnail(job: string, picture: HTMLCanvasElement | ImageBitmap): void {
  const small = document.createElement("canvas");
  small.width = small.height = SIDE;
  const side = Math.min(picture.width, picture.height);
  const [x, y] = [(picture.width - side) / 2, (picture.height - side) / 2];
  const context = small.getContext("2d");
  if (context) context.imageSmoothingQuality = "high";
  context?.drawImage(picture, x, y, side, side, 0, 0, SIDE, SIDE);
  storage.set(nameOf(job), small.toDataURL("image/webp"));
}

export const thumbnail = (job: string): string | null => storage.get(nameOf(job));

/** Makes pictures of jobs that have none yet. The job that is open has one when it is drawn. */
export function makeThumbnails(jobs: Job[]): void {
  for (const job of jobs) {
    const { id, state } = job;
    const isComing =
      id === address.read().job && address.read().colours === null && !storage.keys().some((key) => key.endsWith(id));
    if (state !== "succeeded" || asked.has(nameOf(id)) || thumbnail(id) || isComing) continue;
    asked.add(nameOf(id));
    making = making
      .then(idle)
      .then(() => (thumbnail(id) ? undefined : kindOf(job) === "mesh" ? draw(job) : fetchMeans(job)))
      .catch(() => {});
  }
}

const idle = (): Promise<unknown> =>
  new Promise((resolve) => ("requestIdleCallback" in window ? requestIdleCallback(resolve) : setTimeout(resolve, 200)));

async function fetchMeans(job: Job): Promise<void> {
  const { id, urls } = job;
  const path = urls["means"] && output(job, "means", { clusters: firstCut(job) });
  const { signal } = new AbortController();
  const bytes = path ? await length(path, signal) : null;
  if (!path || bytes === null || bytes > MOST_BYTES) return;
  const means = await pixelsOf(await (await request(path, { signal })).blob());
  keepThumbnail(id, means);
  means.close();
}

async function draw(job: Job): Promise<void> {
  if (!job.keep_mesh || (job.result?.faces ?? Infinity) > MOST_FACES) return;
  const { signal } = new AbortController();
  const clusters = firstCut(job);
  const drawing = await scene();
  const path = output(job, "mesh", { format: "glb", colours: "none", clusters });
  const mesh = await drawing.triangles(await (await request(path, { signal })).arrayBuffer());
  const coloured = new Coloured();
  coloured.setMesh(mesh);
  coloured.set((await labels(job, clusters, signal)).numbers);
  await idle();
  const box = make("div", { class: "view unseen", inert: true });
  document.body.append(box);
  let view: InstanceType<typeof drawing.View> | null = null;
  try {
    view = new drawing.View(box, mesh, job.mesh.format);
    view.show(coloured.shown(null));
    const drawn = view;
    await new Promise<void>((resolve, reject) => {
      setTimeout(reject, PATIENCE_MS);
      drawn.onSettled = (canvas) => {
        keepThumbnail(job.id, canvas);
        resolve();
      };
    });
  } finally {
    view?.dispose();
    box.remove();
  }
}
