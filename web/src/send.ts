// Sends a mesh or an image, and says how much of it is sent. `fetch` does not say that, so this is an XMLHttpRequest.
//
// A file whose sending breaks is sent again when the service is back. The same Idempotency-Key makes the same job of
// it, whether or not the service had accepted the first one.

import { type Job, type Problem, json, pause, refusal, token, untilLater } from "./api";
import { isImage } from "./kinds";

/** Breaks in a row, with a service that answers, after which it is an error. */
const MOST_BREAKS = 3;

const PAUSE_MS = 1000;

export interface Progress {
  sent: number;
  total: number;
}

export async function send(
  files: File[],
  parameters: Record<string, unknown>,
  signal: AbortSignal,
  onProgress: (progress: Progress) => void,
  onBreak: () => void,
  /** The format of the file, where it is not that of its name. */
  format: string | null = null,
): Promise<Job> {
  const form = new FormData();
  const [mesh, ...buffers] = files;
  if (!mesh) throw new Error("there is no file to send");
  form.append("parameters", new Blob([JSON.stringify(parameters)], { type: "application/json" }));
  form.append(isImage(mesh.name) ? "points" : "mesh", mesh, mesh.name);
  for (const buffer of buffers) form.append("buffer", buffer, buffer.name);
  const key = Array.from(crypto.getRandomValues(new Uint32Array(4)), (part) => part.toString(16)).join("-");
  for (let breaks = 0; ;) {
    try {
      return await post(form, format, key, signal, onProgress);
    } catch (error) {
      if (!(error instanceof TypeError)) {
        await untilLater(error, signal);
        continue;
      }
      for (const file of files) await readable(file);
      onBreak();
      const answer = await json("/v1/version", { signal }).catch(() => null);
      breaks = answer === null ? 0 : breaks + 1;
      if (breaks === MOST_BREAKS) throw new Error("the connection breaks while the file is sent");
    }
    await pause(PAUSE_MS, signal);
  }
}

/** A request for a job; a connection that breaks is a `TypeError`, as with `fetch`. */
function post(
  form: FormData,
  format: string | null,
  key: string,
  signal: AbortSignal,
  onProgress: (progress: Progress) => void,
): Promise<Job> {
  const request = new XMLHttpRequest();
  const abort = (): void => request.abort();
  const answer = new Promise<Job>((resolve, reject) => {
    request.upload.addEventListener("progress", ({ loaded, total }) => onProgress({ sent: loaded, total }));
    request.addEventListener("load", () => {
      const body: unknown = request.response;
      if (request.status < 300 && body !== null) resolve(body as Job);
      else reject(refusal(request.status, (body ?? {}) as Partial<Problem>, request.getResponseHeader("retry-after")));
    });
    request.addEventListener("error", () => reject(new TypeError("the connection broke")));
    request.addEventListener("abort", () => reject(new DOMException("stopped", "AbortError")));
  });
  signal.addEventListener("abort", abort, { once: true });
  request.open("POST", `/v1/jobs${format === null ? "" : `?format=${format}`}`);
  request.responseType = "json";
  request.setRequestHeader("idempotency-key", key);
  const mine = token.get();
  if (mine !== "") request.setRequestHeader("authorization", `Bearer ${mine}`);
  request.send(form);
  return answer.finally(() => signal.removeEventListener("abort", abort));
}

/** A file that changed since it was chosen cannot be read any more. */
async function readable(file: File): Promise<void> {
  await file
    .slice(0, 1)
    .arrayBuffer()
    .catch(() => {
      throw new Error(`the file changed or is gone since it was chosen, choose it again: ${file.name}`);
    });
}
