// What a job is on as it was uploaded, for a page that did not send it: a mesh until the job ends, an image that is kept.

import { type Job, length, nameOf, output, request } from "./api";
import { isImage } from "./kinds";

/** Bytes above which a mesh is not fetched for its picture. */
const MOST_BYTES = 1e9;

/** The mesh first, then its buffers. */
export async function uploaded(job: Job, signal: AbortSignal): Promise<File[]> {
  const { format, buffers } = job.mesh;
  const paths = [output(job, "upload", {}), ...buffers.map((buffer) => output(job, "upload", { buffer }))];
  const lengths = await Promise.all(paths.map((path) => length(path, signal)));
  if (lengths.reduce<number>((all, bytes) => all + (bytes ?? 0), 0) > MOST_BYTES) throw new Error("it is above 1 GB");
  const get = async (name: string, buffer: string | null): Promise<File> => {
    const response = await request(output(job, "upload", { buffer }), { signal });
    return new File([await response.blob()], name);
  };
  const name = isImage(nameOf(job)) ? nameOf(job) : `mesh.${format}`;
  return await Promise.all([get(name, null), ...buffers.map((name) => get(name, name))]);
}
