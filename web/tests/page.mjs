// The page in Chromium against a real service:
//   node web/tests/page.mjs BINARY [--pictures FOLDER] [--files FOLDER] [--only NAME] [MESHES]
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { existsSync, mkdirSync, readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import { parseArgs } from "node:util";
import { Browser, look } from "./browser.mjs";
import { Service, until } from "./service.mjs";

const { positionals, values } = parseArgs({
  allowPositionals: true,
  options: { pictures: { type: "string" }, files: { type: "string" }, only: { type: "string" } },
});
const [binary, meshes] = positionals;
const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const text = (page, selector) => page.locator(selector).textContent();
const succeeded = (page) => until("the job succeeds", async () => (await text(page, "#state")).startsWith("succeeded"));
const drawn = async (page, clusters) =>
  await until(`${clusters} clusters are drawn`, () =>
    page.evaluate((k) => {
      const [view, canvas] = [document.querySelector("#view"), document.querySelector("#view canvas")];
      return view?.dataset.clusters === String(k) && Number(canvas?.dataset.frames) > 0;
    }, clusters),
  );
const idOf = (page) => /jobs\/([0-9a-f-]+)/.exec(page.url())[1];

async function picture(page, name) {
  if (!values.pictures) return;
  mkdirSync(values.pictures, { recursive: true });
  await page.evaluate(() => document.querySelector(innerWidth < 500 ? "#job" : "header").scrollIntoView());
  await page.screenshot({ path: join(values.pictures, name) });
}

function sample(service, name, faces) {
  const path = join(service.folder, `${name}.obj`);
  execFileSync(binary, ["sample", name, "--faces", String(faces), path]);
  return path;
}

/** Drops a file on the page, as a pointer does. */
async function drop(page, path, name) {
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

async function submit(page, path, { name, clusters, algorithm, quality }) {
  await drop(page, path, name);
  if (clusters) await page.fill("#clusters", String(clusters));
  if (algorithm) await page.selectOption("#algorithm", algorithm);
  if (quality) await page.selectOption("#quality", quality);
  const before = page.url();
  await page.click("#submit");
  await until("the job is open", async () => page.url() !== before && (await page.locator("#state").count()) > 0);
}

async function labels(service, id, clusters) {
  const cut = clusters ? `&clusters=${clusters}` : "";
  const answer = await fetch(`${service.url}/v1/jobs/${id}/labels?format=bin${cut}`);
  assert.equal(answer.status, 200);
  return new Uint32Array(await answer.arrayBuffer());
}

async function accessible(page, where) {
  await page.evaluate(axe);
  for (const colorScheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme });
    const { violations } = await page.evaluate(() => axe.run());
    const found = violations.map(({ id, nodes }) => `${id}: ${nodes.map((node) => node.html).join(" ")}`);
    assert.deepEqual(found, [], `${where}, ${colorScheme}`);
  }
  await page.emulateMedia({ colorScheme: "light" });
}

const tests = {
  async "an empty service shows a drop zone and samples, and a sample becomes clusters"({ service, browser }) {
    const page = await browser.open(service.url);
    const paint = await until("the page is painted", () =>
      page.evaluate(() =>
        performance
          .getEntriesByName("first-paint")
          .map((entry) => Math.round(entry.startTime))
          .at(0),
      ),
    );
    console.log(`  first paint after ${paint} ms`);
    assert.ok(await page.locator("#drop").isVisible());
    assert.equal(await text(page, "#jobs"), "none yet");
    await accessible(page, "first visit");
    await page.locator("[data-sample=knot]").focus();
    await page.keyboard.press("Enter");
    await page.waitForSelector("#curve[data-points]");
    await succeeded(page);
    await drawn(page, 400);
    assert.ok((await look(page, "#view")).hues > 10, "the view has the colours of many clusters");
    const report = await (await fetch(`${service.url}/v1/jobs/${idOf(page)}/report`)).json();
    assert.equal(Number(await page.getAttribute("#curve", "data-points")), report.iterations.length);
    const [first, last] = [report.iterations[0], report.iterations.at(-1)];
    assert.ok(last.energy < first.energy);
    assert.match(await page.getAttribute("#curve", "aria-label"), new RegExp(`after iteration ${last.iteration}`));
    await accessible(page, "a job");
    await picture(page, "page.png");
    await page.close();
  },

  async "a click names the cluster under it, whose colour the pixel has; keys turn the mesh"({ service, browser }) {
    const page = await browser.open(service.url);
    await submit(page, sample(service, "quads", 6000), { name: "quads.obj", clusters: 30 });
    await succeeded(page);
    await drawn(page, 30);
    const shown = await labels(service, idOf(page));
    const { width, height } = await page.locator("#view canvas").boundingBox();
    await page.locator("#view canvas").click({ position: { x: width / 2, y: height / 2 } });
    await until("the service's numbers of the cluster are there", async () =>
      /neighbours, energy \d/.test(await text(page, "#picked")),
    );
    const [, cluster, faces] = /cluster (\d+): ([\d,]+) faces/.exec(await text(page, "#picked"));
    assert.equal(
      Number(faces),
      shown.filter((label) => label === Number(cluster)).length,
      "polygons count, not triangles",
    );
    await page.mouse.move(0, 0);
    const { centre: pixel, digest } = await look(page, "#view");
    await page.locator("details:has(#cluster-table) summary").click();
    const swatch = page.locator("#cluster-table [aria-pressed=true] .swatch");
    const colour = (await swatch.evaluate((span) => getComputedStyle(span).backgroundColor)).match(/\d+/g).map(Number);
    for (const channel of [0, 1, 2]) {
      const [seen, meant] = [pixel[channel] / Math.max(...pixel), colour[channel] / Math.max(...colour)];
      assert.ok(Math.abs(seen - meant) < 0.06, `pixel ${pixel}, colour ${colour}`);
    }
    assert.match(page.url(), new RegExp(`cluster=${cluster}`));
    await page.locator("#view canvas").focus();
    await page.keyboard.press("ArrowLeft");
    await until("the mesh turns", async () => (await look(page, "#view")).digest !== digest);
    await page.reload();
    await drawn(page, 30);
    await until("the reloaded page has the selection", async () =>
      (await text(page, "#picked")).startsWith(`cluster ${cluster}:`),
    );
    await page.close();
  },

  async "the slider cuts a hierarchy into the labels that the interface gives"({ service, browser }) {
    const page = await browser.open(service.url);
    await submit(page, sample(service, "terrain", 20_000), { name: "terrain.obj", algorithm: "pml" });
    await succeeded(page);
    await drawn(page, 100);
    for (const clusters of [12, 777]) {
      await page.fill("#level-number", String(clusters));
      await page.locator("#level-number").blur();
      await drawn(page, clusters);
      const counts = new Map();
      for (const label of await labels(service, idOf(page), clusters)) counts.set(label, (counts.get(label) ?? 0) + 1);
      await page.evaluate(() => (document.querySelector("details:has(#cluster-table)").open = true));
      const rows = await page
        .locator("#cluster-table tbody tr")
        .evaluateAll((rows) => rows.map((row) => [...row.cells].map((cell) => cell.textContent)));
      assert.equal(rows.length, Math.min(20, clusters));
      for (const [name, faces] of rows) {
        assert.equal(Number(faces.replace(",", "")), counts.get(Number(name.split(" ")[1])), `${name} of ${clusters}`);
      }
    }
    await page.locator("#level").focus();
    await page.keyboard.press("End");
    await drawn(page, (await labels(service, idOf(page), 12)).length);
    await page.fill("#level-number", "60");
    await page.locator("#level-number").blur();
    await drawn(page, 60);
    await page.locator("#dendrogram").evaluate((element) => (element.parentElement.open = true));
    await page.waitForSelector("#dendrogram svg path");
    assert.equal(await page.locator("#dendrogram path").count(), 63);
    await accessible(page, "a hierarchy");
    await picture(page, "page-hierarchy.png");
    await page.close();
  },

  async "downloads have the bytes of the interface, and the remesh lies over the mesh"({ service, browser }) {
    const page = await browser.open(service.url);
    await page.click("#jobs a:has-text('quads')");
    await drawn(page, 30);
    await page.check("#remesh");
    await until("the remesh is drawn", () =>
      page.evaluate(() => Number(document.querySelector("#view").dataset.edges) > 30),
    );
    await page.locator("details:has(#downloads) summary").click();
    for (const [name, extension, begins] of [
      ["labels", "npy", "\x93NUMPY"],
      ["mesh", "glb", "glTF"],
      ["remesh", "ply", "ply\n"],
    ]) {
      const [download] = await Promise.all([
        page.waitForEvent("download"),
        page.click(`[aria-label="Download ${name} as ${extension}"]`),
      ]);
      assert.equal(download.suggestedFilename(), `quads-${name}.${extension}`);
      const bytes = readFileSync(await download.path());
      assert.equal(bytes.subarray(0, begins.length).toString("latin1"), begins);
      const answer = await fetch(`${service.url}/v1/jobs/${idOf(page)}/${name}?format=${extension}`);
      assert.ok(bytes.equals(Buffer.from(await answer.arrayBuffer())), `${name}.${extension}`);
    }
    await until("every file has its size", async () =>
      (await page.locator("#downloads .size").allTextContents()).every((told) => /^[\d.]+ k?M?B$/.test(told)),
    );
    await page.close();
  },

  async "two jobs of one mesh are compared"({ service, browser }) {
    const page = await browser.open(service.url);
    await submit(page, sample(service, "quads", 6000), { name: "quads.obj", clusters: 50, quality: "best" });
    await succeeded(page);
    await drawn(page, 50);
    await page.selectOption("#other", { index: 1 });
    await drawn(page, 30);
    assert.match(await text(page, "#compared"), /its energy: \d/);
    assert.match(page.url(), /with=/);
    await page.close();
  },

  async "names are text"({ service, browser }) {
    const page = await browser.open(service.url);
    const name = `<img src=x onerror=window.hit=1>'&quot;.obj`;
    await submit(page, sample(service, "sphere", 500), { name, clusters: 5 });
    await succeeded(page);
    await drawn(page, 5);
    assert.equal(await text(page, "#job-title"), name);
    assert.equal(await page.locator("img").count(), 0);
    assert.equal(await page.evaluate(() => window.hit), undefined);
    await page.click("#remove");
    await until("the job is gone", async () => !(await text(page, "#jobs")).includes("onerror"));
    await page.close();
  },

  async "what cannot be done is said"({ service, browser }) {
    const page = await browser.open(service.url);
    await submit(page, sample(service, "sphere", 500), { name: "sphere.obj", clusters: 100_000 });
    await until("the job fails", async () => (await text(page, "#state")).startsWith("failed: "));
    assert.match(await text(page, "#state"), /clusters/);
    await page.goto(`${service.url}/#/jobs/00000000-0000-4000-8000-000000000000`);
    await until("the job is not there", async () => /no such job|no job/i.test(await text(page, "#notice")));
    await page.close();
  },

  async "a service that is killed and comes back loses nothing, and the page needs no reload"({ service, browser }) {
    const page = await browser.open(service.url);
    await page.evaluate(() => (window.marker = 1));
    await submit(page, sample(service, "knot", 120_000), { name: "slow.obj", clusters: 3000, algorithm: "acvd" });
    await until("it runs", async () => (await text(page, "#state")).startsWith("running"));
    await page.waitForSelector("#preview canvas[data-frames]");
    await service.kill();
    await until("the page says so", async () => /does not answer/.test(await text(page, "#notice")));
    await service.again();
    await succeeded(page);
    await drawn(page, 3000);
    assert.equal(await text(page, "#notice"), "");
    assert.equal(await page.evaluate(() => window.marker), 1);
    await page.close();
  },

  async "a phone's width has no sideways scrolling"({ service, browser }) {
    const page = await browser.open(service.url, {
      viewport: { width: 360, height: 740 },
      colorScheme: "dark",
      reducedMotion: "reduce",
    });
    await page.click("#jobs a:has-text('knot')");
    await drawn(page, 400);
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth));
    await picture(page, "page-phone.png");
    await page.close();
  },

  async "a token is kept for the session and sent in a header"({ browser }) {
    const service = new Service(binary);
    try {
      const file = join(service.folder, "tokens.json");
      const token = execFileSync(binary, ["token", "new", "mine", "--tokens", file]).toString().trim();
      await service.start("--tokens", file);
      const page = await browser.open(service.url);
      await until("a token is needed", async () => /token/.test(await text(page, "#notice")));
      await page.fill("#token", token);
      await page.keyboard.press("Enter");
      await until("the jobs are listed", async () => (await text(page, "#jobs")) === "none yet");
      await page.click("[data-sample=parts]");
      await page.waitForSelector("#state");
      await succeeded(page);
      await page.reload();
      await succeeded(page);
      await drawn(page, 400);
      assert.ok(!page.url().includes(token));
      assert.deepEqual(await page.evaluate(() => [localStorage.length, document.cookie, sessionStorage.length]), [
        0,
        "",
        1,
      ]);
      await page.close();
    } finally {
      await service.stop();
    }
  },

  async "a real file"({ service, browser }) {
    const path = meshes && join(meshes, "stanford-bunny.glb");
    if (!path || !existsSync(path)) return console.log("  left out: there is no folder of meshes");
    const page = await browser.open(service.url);
    await submit(page, path, { name: "stanford-bunny.glb", clusters: 1000 });
    await succeeded(page);
    await drawn(page, 1000);
    assert.ok((await look(page, "#view")).hues > 20);
    await page.close();
  },
};

const browser = await new Browser(values.files).launch();
const service = await new Service(binary).start();
let failures = 0;
for (const [name, test] of Object.entries(tests)) {
  if (values.only && !name.includes(values.only)) continue;
  const started = Date.now();
  try {
    await test({ service, browser });
    assert.deepEqual(browser.complaints.splice(0), []);
    console.log(`ok, ${((Date.now() - started) / 1000).toFixed(1)} s: ${name}`);
  } catch (error) {
    failures += 1;
    console.error(`FAILED: ${name}\n${error.stack}`);
    if (browser.complaints.length > 0) console.error(browser.complaints.splice(0).join("\n"));
  }
}
// what the tests above look for is found where it is
const page = await browser.open(service.url);
await page.evaluate(() => {
  document.body.append(Object.assign(document.createElement("script"), { textContent: "window.hit = 1" }));
  void fetch("http://127.0.0.2:9/").catch(() => {});
});
await until("violations are noticed", () => browser.complaints.some((text) => text.startsWith("violation")));
assert.equal(await page.evaluate(() => window.hit), undefined, "the policy does not stop inline scripts");
await browser.close();
await service.stop();
if (failures > 0) console.error(service.log.slice(-3000));
process.exit(failures > 0 ? 1 : 0);
