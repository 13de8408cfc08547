// What every test of the page does: makes meshes, drops them, waits for clusters, compares with the interface.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdirSync, readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import { parseArgs } from "node:util";
import { screenshot } from "./browser.mjs";
import { Service, until } from "./service.mjs";

export const { positionals, values } = parseArgs({
  allowPositionals: true,
  options: {
    pictures: { type: "string" },
    files: { type: "string" },
    only: { type: "string" },
    times: { type: "boolean" },
  },
});
export const [binary, meshes] = positionals;
const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
export const text = (page, selector) => page.locator(selector).textContent();
export const succeeded = (page) =>
  until("the job succeeds", async () => (await page.getAttribute("#state", "data-state")) === "succeeded");
export const drawn = async (page, clusters) =>
  await until(`${clusters} clusters are drawn`, () =>
    page.evaluate((k) => {
      const [view, canvas] = [document.querySelector("#view"), document.querySelector("#view canvas")];
      return view?.dataset.clusters === String(k) && Number(canvas?.dataset.frames) > 0;
    }, clusters),
  );
export const idOf = (page) => /jobs\/([0-9a-f-]+)/.exec(page.url())[1];

/** A picture of what is in sight. */
export async function picture(page, name) {
  if (!values.pictures) return;
  mkdirSync(values.pictures, { recursive: true });
  const small = name.endsWith(".jpg") ? { quality: 60 } : {};
  await screenshot(page, { path: join(values.pictures, name), ...small });
}

/** Opens the page of a service that has no other jobs, whose small pictures would be made meanwhile. */
export async function alone(browser, options, test) {
  const service = await new Service(binary).start();
  try {
    const page = await browser.open(service.url, { viewport: { width: 1280, height: 720 }, knot: true, ...options });
    await test(page, service);
    await page.close();
  } finally {
    await service.stop();
  }
}

export function sample(service, name, faces, extension = "obj") {
  const path = join(service.folder, `${name}.${extension}`);
  execFileSync(binary, ["sample", name, "--faces", String(faces), path], { timeout: 60_000 });
  return path;
}

/** Drops a file on the page, as a pointer does. */
export async function drop(page, path, name) {
  const bytes = readFileSync(path).toString("base64");
  const transfer = await page.evaluateHandle(
    ([data, name]) => {
      const transfer = new DataTransfer();
      transfer.items.add(new File([Uint8Array.from(atob(data), (c) => c.charCodeAt(0))], name));
      return transfer;
    },
    [bytes, name],
  );
  await page.dispatchEvent("#drop", "drop", { dataTransfer: transfer });
}

export async function submit(page, path, { name, clusters, algorithm, quality }) {
  await drop(page, path, name);
  await page.selectOption("#algorithm", algorithm ?? "bb");
  if (clusters) await page.fill("#clusters", String(clusters));
  if (quality) await page.selectOption("#quality", quality);
  const before = page.url();
  await page.click("#submit");
  await until("the job is open", async () => page.url() !== before && (await page.locator("#state").count()) > 0);
}

export async function labels(service, id, clusters) {
  const cut = clusters ? `&clusters=${clusters}` : "";
  const answer = await fetch(`${service.url}/v1/jobs/${id}/labels?format=bin${cut}`);
  assert.equal(answer.status, 200);
  return new Uint32Array(await answer.arrayBuffer());
}

/** Runs what was copied, as curl, in the folder of the service; gives the job that it made, when that has ended. */
export async function run(command, service, env = {}) {
  const options = { cwd: service.folder, timeout: 60_000, env: { ...process.env, ...env } };
  const told = execFileSync("sh", ["-c", command], options).toString();
  const { id } = JSON.parse(told);
  assert.ok(id, told);
  const { TOKEN } = env;
  const headers = TOKEN ? { authorization: `Bearer ${TOKEN}` } : {};
  const job = `${service.url}/v1/jobs/${id}`;
  await until("it is made", async () => (await (await fetch(job, { headers })).json()).state === "succeeded");
  return id;
}

export async function accessible(page, where) {
  await page.evaluate(axe);
  for (const colorScheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme });
    const { violations } = await page.evaluate(() => axe.run());
    const found = violations.map(({ id, nodes }) => `${id}: ${nodes.map((node) => node.html).join(" ")}`);
    assert.deepEqual(found, [], `${where}, ${colorScheme}`);
  }
  await page.emulateMedia({ colorScheme: "light" });
}

/** Deletes the job that is open, by its menu. */
export async function remove(page) {
  await page.click(".menu summary");
  await page.click("#remove");
}

/** Stops the time of deletions, which is over at `pass(page)`. */
export const hold = (page) =>
  page.addInitScript((now) => {
    const [set, clear, held] = [window.setTimeout, window.clearTimeout, []];
    window.setTimeout = (work, ms, ...rest) => (ms === 10_000 ? -held.push(work) : set(work, ms, ...rest));
    window.clearTimeout = (id) => (id < 0 ? delete held[-id - 1] : clear(id));
    window.pass = () => held.splice(0).forEach((work) => work());
    Date.now = () => now;
  }, Date.now());

export const pass = (page) => page.evaluate(() => window.pass());

/** The numbers of the selected cluster: `fact(page, "faces")`. */
export const fact = async (page, name) => await page.locator(`#picked [data-fact=${name}]`).textContent();

/** Keeps every text that the state of a job has from now on, without a reload in between. */
export const recordStates = (page) =>
  page.evaluate(() => {
    window.states = [];
    const take = () => window.states.push(document.querySelector("#state")?.textContent ?? "");
    new MutationObserver(take).observe(document.querySelector("#job"), { childList: true, subtree: true });
  });

export const statesOf = (page) => page.evaluate(() => window.states);
