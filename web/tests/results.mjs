// What a job gave, as people see it.
import assert from "node:assert/strict";
import { existsSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { look, screenshot } from "./browser.mjs";
import { until } from "./service.mjs";
import {
  accessible,
  drawn,
  fact,
  idOf,
  labels,
  meshes,
  picture,
  recordStates,
  sample,
  statesOf,
  submit,
  succeeded,
  text,
} from "./steps.mjs";

export const results = {
  async "an empty service shows a drop zone and samples, and a sample becomes clusters"({ service, browser }) {
    /** When something is painted, in milliseconds, by a browser that is there already. */
    const painted = async (path) => {
      const page = await browser.open(
        service.url,
        { viewport: { width: 1280, height: 720 }, knot: true },
        async (page) => {
          await page.goto("about:blank");
          await screenshot(page);
        },
        path,
      );
      const paint = await until("something is painted", () =>
        page.evaluate(() => performance.getEntriesByName("first-paint")[0]?.startTime),
      );
      return { page, paint: Math.round(paint) };
    };
    const plain = await painted("/licences.txt");
    await plain.page.close();
    const { page, paint } = await painted("/");
    console.log(`  first paint after ${paint} ms, of a file of text after ${plain.paint} ms`);
    const loaded = (name) =>
      until(`${name} is loaded`, () =>
        page.evaluate((name) => performance.getEntriesByName(`${origin}/${name}`)[0]?.toJSON(), name),
      );
    const drawing = (await loaded("scene.js")).startTime;
    for (const name of ["page.js", "page.css"])
      assert.ok(drawing >= (await loaded(name)).responseEnd, `what draws does not delay ${name}`);
    assert.ok(await page.locator("#drop").isVisible());
    assert.equal(await text(page, "#jobs"), "Your jobs appear here.");
    await accessible(page, "first visit");
    await page.selectOption("#algorithm", "bb");
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

  async "the result of a job that has ended does not wait for its events"({ service, browser }) {
    const first = await browser.open(service.url);
    await submit(first, sample(service, "cube", 600), { name: "ended.obj", clusters: 5 });
    await succeeded(first);
    const { hash } = new URL(first.url());
    await first.close();
    let release;
    const held = new Promise((resolve) => (release = resolve));
    const hold = async (route) => {
      await held;
      await route.fallback();
    };
    const page = await browser.open(service.url, {}, (page) => page.route(/\/events\?/, hold), `/${hash}`);
    await drawn(page, 5);
    assert.equal(await page.getAttribute("#curve", "data-points"), null);
    release();
    await page.waitForSelector("#curve[data-points]");
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
    await page.waitForSelector("#picked [data-fact=energy]");
    const [cluster, faces] = [await page.getAttribute("#picked", "data-cluster"), await fact(page, "faces")];
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
    await until(
      "the reloaded page has the selection",
      async () => (await page.getAttribute("#picked", "data-cluster")) === cluster,
    );
    await page.close();
  },

  async "the slider cuts a hierarchy into the labels that the interface gives"({ service, browser }) {
    const page = await browser.open(service.url);
    await recordStates(page);
    await submit(page, sample(service, "terrain", 150_000), { name: "terrain.obj", algorithm: "pml" });
    await succeeded(page);
    const live = (await statesOf(page)).filter((told) => /^Running: [\d,]+ clusters left/.test(told));
    const left = live.map((told) => Number(/([\d,]+) clusters/.exec(told)[1].replaceAll(",", "")));
    assert.ok(left.length > 1 && left.at(-1) < left[0], `the clusters fall while it runs: ${left}`);
    const { levels } = await (await fetch(`${service.url}/v1/jobs/${idOf(page)}/report`)).json();
    assert.equal(Number(await page.getAttribute("#curve", "data-points")), levels.length);
    await drawn(page, 100);
    for (const clusters of [12, 777]) {
      await page.fill("#level-number", String(clusters));
      await page.locator("#level-number").blur();
      await drawn(page, clusters);
      const counts = new Map();
      for (const label of await labels(service, idOf(page), clusters)) counts.set(label, (counts.get(label) ?? 0) + 1);
      await page.evaluate(() => (document.querySelector("details:has(#cluster-table)").open = true));
      const table = page.locator("#cluster-table tbody tr");
      await until("the table is that of the cut", async () => (await table.count()) === Math.min(20, clusters));
      const rows = await table.evaluateAll((rows) => rows.map((row) => [...row.cells].map((cell) => cell.textContent)));
      for (const [name, faces] of rows) {
        assert.equal(Number(faces.replace(",", "")), counts.get(Number(name.split(" ")[1])), `${name} of ${clusters}`);
      }
    }
    const { light } = await look(page, "#view");
    await page.locator("#level").focus();
    await page.keyboard.press("End");
    await drawn(page, (await labels(service, idOf(page), 12)).length);
    const least = 0.75 * light;
    assert.ok((await look(page, "#view")).light > least, "lines do not cover clusters of a pixel");
    await page.fill("#level-number", "60");
    await page.locator("#level-number").blur();
    await drawn(page, 60);
    await page.locator("#dendrogram").evaluate((element) => (element.parentElement.open = true));
    await page.waitForSelector("#dendrogram [role=treeitem]");
    const nodes = page.locator("#dendrogram [role=treeitem]");
    assert.equal(await nodes.count(), 64 + 63);
    /** The node is a cluster of the cut, and the selected one. */
    const chosen = async (node) => {
      const numbers = (await node.getAttribute("aria-label")).match(/\d[\d,]*/g);
      // a merge has faces and clusters left; a cluster at the bottom is one of so many
      const clusters = Number(numbers.at(-1));
      await drawn(page, clusters);
      await until("the node is marked", async () => (await node.getAttribute("aria-selected")) === "true");
      assert.equal(await page.locator("#dendrogram [aria-selected=true]").count(), 1);
      const cluster = Number(/cluster=(\d+)/.exec(page.url())[1]);
      const path = `/v1/jobs/${idOf(page)}/hierarchy?format=json&clusters=${clusters}&max_clusters=63`;
      const { cut, nodes } = await (await fetch(service.url + path)).json();
      const merge = nodes.find(({ id }) => id === cut.nodes[cluster]);
      assert.equal(merge?.faces.toLocaleString("en"), numbers.length === 2 ? numbers[0] : undefined);
    };
    const node = nodes.nth(5);
    const { x, y } = await node
      .locator("path")
      .first()
      .evaluate((path) => {
        path.scrollIntoView({ block: "center" });
        const { x, y } = path.getPointAtLength(path.getTotalLength() / 2).matrixTransform(path.getScreenCTM());
        return { x, y };
      });
    await page.mouse.click(x, y);
    await chosen(node);
    await page.keyboard.press("Home");
    await page.keyboard.press("ArrowDown");
    await page.keyboard.press("Enter");
    const below = page.locator("#dendrogram :focus");
    assert.equal(await below.getAttribute("aria-level"), "2");
    await chosen(below);
    await page.keyboard.press("ArrowRight");
    await page.keyboard.press("ArrowDown");
    await page.keyboard.press(" ");
    await chosen(page.locator("#dendrogram :focus"));
    await accessible(page, "a hierarchy");
    // a click on a selected row selects none
    await page.locator("#cluster-table [aria-pressed=true]").click();
    await page.fill("#level-number", "60");
    await page.locator("#level-number").blur();
    await drawn(page, 60);
    await page.close();
  },

  async "a second click on a cluster splits it, one with Shift merges it, and so do buttons"({ service, browser }) {
    const page = await browser.open(service.url);
    await page.click("#jobs a:has-text('terrain')");
    await drawn(page, 100);
    // before, a place between two clusters may show the one or the other
    await page.waitForSelector("#view canvas[data-settled=true]");
    const canvas = page.locator("#view canvas");
    const { width, height } = await canvas.boundingBox();
    const middle = { position: { x: width / 2, y: height / 2 } };
    const shown = async () => {
      const search = new URLSearchParams(page.url().split("?")[1]);
      return { clusters: Number(search.get("clusters") ?? 100), cluster: Number(search.get("cluster") ?? NaN) };
    };
    /** Selected cluster and its cut, after a step that changes the cut. */
    const after = async (step) => {
      const before = await shown();
      await step();
      await until("another cut is drawn", async () => (await shown()).clusters !== before.clusters);
      const { clusters } = await shown();
      await drawn(page, clusters);
      await until("a cluster is selected", async () => (await shown()).cluster >= 0 && !(await page.isDisabled("#up")));
      const { cluster } = await shown();
      const path = `/v1/jobs/${idOf(page)}/hierarchy?format=json&clusters=${clusters}&max_clusters=0`;
      const { cut } = await (await fetch(service.url + path)).json();
      return { clusters, node: cut.nodes[cluster], parent: cut.parents[cluster] };
    };
    assert.ok(await page.isDisabled("#down"), "nothing is selected");
    await canvas.click(middle);
    await until("a cluster is selected", async () => (await shown()).cluster >= 0);
    const first = await after(() => canvas.click(middle));
    assert.ok(first.clusters > 100);
    const up = await after(() => page.press("#up", "Enter"));
    assert.equal(up.node, first.parent, "upwards from a part is the cluster that was split");
    const { cluster } = await shown();
    const box = await canvas.boundingBox();
    const inside = await until("a place on the selected cluster", async () => {
      for (let i = 0; i < 100; i++) {
        const position = { x: width * (0.3 + 0.04 * (i % 10)), y: height * (0.4 + 0.02 * Math.floor(i / 10)) };
        await page.mouse.move(box.x + position.x, box.y + position.y);
        await page.waitForTimeout(50);
        if ((await page.isVisible("#card")) && (await text(page, "#card strong")) === `Cluster ${cluster}`)
          return { position };
      }
    });
    const above = await after(() => canvas.click({ ...inside, modifiers: ["Shift"] }));
    assert.ok(above.clusters < up.clusters);
    const down = await after(() => page.press("#down", "Enter"));
    assert.equal(down.parent, above.node);
    await page.close();
  },

  async "downloads have the bytes of the interface, and the remesh lies over the mesh"({ service, browser }) {
    const page = await browser.open(service.url);
    await page.click("#jobs a:has-text('quads')");
    await drawn(page, 30);
    await page.click("#remesh");
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
    const page = await browser.open(service.url, { viewport: { width: 1280, height: 720 } });
    await submit(page, sample(service, "quads", 6000), { name: "quads.obj", clusters: 50, quality: "best" });
    await succeeded(page);
    await drawn(page, 50);
    await page.selectOption("#other", { index: 1 });
    await until("compactness is compared, where the numbers of clusters differ", async () =>
      /^Compactness: \d.* % of a honeycomb against \d.* % here.$/.test(await text(page, "#compared")),
    );
    const other = /with=([0-9a-f-]+)/.exec(page.url())[1];
    await page.waitForSelector("#view [data-panes='2']");
    const halves = async () => [await look(page, "#view", 0, 0.5), await look(page, "#view", 0.5, 1)];
    let before = [];
    await until("the picture is at rest", async () => {
      const earlier = before;
      before = await halves();
      await page.waitForTimeout(500);
      return before.every(({ digest }, i) => digest === earlier[i]?.digest);
    });
    assert.ok(
      before.every(({ hues }) => hues > 5),
      "both have the colours of clusters",
    );
    assert.notEqual(before[0].digest, before[1].digest);
    await page.reload();
    await until(
      "a reload shows the same",
      async () =>
        (await page.locator("#view canvas").count()) > 0 &&
        (await halves()).every(({ digest }, i) => digest === before[i].digest),
    );
    // the cameras are one
    await page.locator("#view canvas").focus();
    await page.keyboard.press("ArrowLeft");
    await until("both are turned", async () => (await halves()).every(({ digest }, i) => digest !== before[i].digest));
    const { width, height } = await page.locator("#view canvas").boundingBox();
    const [mine, theirs] = [await labels(service, idOf(page)), await labels(service, other)];
    const [, right] = await halves();
    for (const place of [0.25, 0.75]) {
      await page.locator("#view canvas").click({ position: { x: place * width, y: height / 2 } });
      const told = /^cluster (\d+): ([\d,]+) faces, ([\d,]+) in common$/;
      const number = (text) => Number(text.replace(",", ""));
      const [, b, inB, common] = told.exec(await fact(page, "beside")).map(number);
      const [a, inA] = [await page.getAttribute("#picked", "data-cluster"), await fact(page, "faces")].map(number);
      const isMine = (face) => mine[face] === a;
      const faces = [...theirs.keys()].filter((face) => theirs[face] === b);
      assert.deepEqual([inA, inB], [mine.filter((label) => label === a).length, faces.length]);
      assert.equal(common, faces.filter(isMine).length);
      assert.ok(common > 0);
      if (place < 0.5) continue;
      const swatch = await page.locator("#picked .swatch").evaluate((span) => getComputedStyle(span).backgroundColor);
      const hue = swatch.match(/\d+/g).map(Number);
      const apart = hue.map((channel, i) => channel / Math.max(...hue) - right.centre[i] / Math.max(...right.centre));
      assert.ok(Math.max(...apart.map(Math.abs)) < 0.06, `its counterpart has its hue: ${right.centre}, ${swatch}`);
    }
    await accessible(page, "a comparison");
    await picture(page, "page-compare.png");
    await page.check("#wipe");
    await page.waitForSelector("#view [data-panes='2 parted']");
    const parted = async () => (await look(page, "#view", 0.3, 0.7)).digest;
    const first = await parted();
    await page.locator("#line").focus();
    await page.keyboard.press("Home");
    await until("the line moves", async () => (await parted()) !== first);
    await page.reload();
    await page.waitForSelector("#view [data-panes='2 parted']");
    await page.uncheck("#wipe");
    await page.waitForSelector("#view [data-panes='2']");
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
    assert.ok(Math.abs((await page.locator("#main").boundingBox()).y) < 2, "the job is in sight, above form and list");
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth));
    await picture(page, "page-phone.png");
    await accessible(page, "a phone");
    await page.close();
  },

  async "a real file"({ service, browser }) {
    const path = meshes && join(meshes, "stanford-bunny.glb");
    if (!path || !existsSync(path)) return console.log("  left out: there is no folder of meshes");
    const page = await browser.open(service.url);
    await submit(page, path, { name: "stanford-bunny.glb", clusters: 1000 });
    await succeeded(page);
    await drawn(page, 1000);
    assert.ok((await look(page, "#view")).hues > 7);
    await page.close();
  },
};
