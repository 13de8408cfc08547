// What colours, words and small pictures say: that they are those of what is shown.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { until } from "./service.mjs";
import { accessible, drawn, fact, idOf, sample, submit, succeeded, text } from "./steps.mjs";

const colourOf = (locator) => locator.evaluate((element) => getComputedStyle(element).backgroundColor);

/** Edges of an OBJ file at which two triangles bend by more than some degrees. */
function sharpEdges(obj, angle) {
  const rows = (kind) => [...obj.matchAll(new RegExp(`^${kind} (.*)$`, "gm"))].map(([, row]) => row.split(" "));
  const vertices = rows("v").map((row) => row.map(Number));
  const normals = new Map();
  let count = 0;
  for (const row of rows("f")) {
    const corners = row.map((corner) => parseInt(corner) - 1);
    const [a, b, c] = corners.map((corner) => vertices[corner]);
    const [u, v] = [b, c].map((to) => to.map((x, axis) => x - a[axis]));
    const normal = [0, 1, 2].map((i) => u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3]);
    for (let i = 0; i < 3; i++) {
      const edge = [corners[i], corners[(i + 1) % 3]].sort().join();
      const other = normals.get(edge);
      normals.set(edge, normal);
      if (!other) continue;
      const cosine =
        normal.reduce((sum, x, axis) => sum + x * other[axis], 0) / Math.hypot(...normal) / Math.hypot(...other);
      if (cosine < Math.cos((angle * Math.PI) / 180)) count += 1;
    }
  }
  return count;
}

export const words = {
  async "a cluster that the address names faces the viewer"({ service, browser }) {
    const page = await browser.open(service.url);
    await submit(page, sample(service, "sphere", 3000), { name: "ball.obj", clusters: 20 });
    await succeeded(page);
    await drawn(page, 20);
    const { clusters } = await (await fetch(`${service.url}/v1/jobs/${idOf(page)}/clusters?format=json`)).json();
    const canvas = page.locator("#view canvas");
    const { width, height } = await canvas.boundingBox();
    const middle = async () => {
      await until("a card is at the pointer", async () => {
        await page.mouse.move(0, 0);
        await canvas.hover({ position: { x: width / 2, y: height / 2 } });
        return await page.isVisible("#card");
      });
      return Number(/\d+/.exec(await text(page, "#card strong"))[0]);
    };
    const front = clusters[await middle()].centroid;
    const along = ({ centroid }) => centroid.reduce((sum, x, axis) => sum + x * front[axis], 0);
    const behind = clusters.reduce((best, cluster, i) => (along(cluster) < along(clusters[best]) ? i : best), 0);
    await page.goto(`${page.url().split("?")[0]}?cluster=${behind}`);
    await page.reload();
    await drawn(page, 20);
    await until("it is in the middle", async () => (await middle()) === behind);
    await page.close();
  },

  async "a shape has the colour of its type, and no energy of another kind"({ service, browser }) {
    const page = await browser.open(service.url);
    const path = sample(service, "part", 3000);
    await submit(page, path, { name: "typed.obj", clusters: 13, algorithm: "shapes" });
    await succeeded(page);
    await drawn(page, 13);
    await page.waitForSelector("#curve[data-points]");
    await page.selectOption("#colours", "shape");
    const { shapes } = await (await fetch(`${service.url}/v1/jobs/${idOf(page)}/report`)).json();
    const legend = await page.locator("#legend .swatch").all();
    const types = ["plane", "sphere", "cylinder"];
    await page.click("details:has(#cluster-table) summary");
    for (const { label, type } of shapes) {
      await page.locator("#cluster-table tbody button").nth(label).click();
      await until("it is selected", async () => (await page.getAttribute("#picked", "data-cluster")) === String(label));
      const wanted = await colourOf(legend[types.indexOf(type)]);
      assert.equal(await colourOf(page.locator("#picked .swatch")), wanted, `cluster ${label}`);
      assert.equal(await colourOf(page.locator("#cluster-table tbody .swatch").nth(label)), wanted, `row ${label}`);
    }
    await fact(page, "perimeter");
    assert.equal(await page.locator("#picked [data-fact=energy]").count(), 0);
    assert.equal(await page.locator("#colours option[value=energy]").count(), 0);
    await page.click("#sharp");
    const edges = async () => Number(await page.getAttribute("#view", "data-edges"));
    await until("edges are drawn", async () => (await edges()) > 0);
    assert.equal(await edges(), sharpEdges(readFileSync(path, "utf8"), 40));
    await page.click("#remesh");
    await until(
      "edges of the remesh are drawn",
      async () => (await edges()) !== sharpEdges(readFileSync(path, "utf8"), 40),
    );
    assert.equal(await page.getAttribute("#sharp", "aria-pressed"), "false");
    const before = await edges();
    await page.reload();
    await until("they are drawn after a reload, too", async () => (await edges()) === before);
    await page.close();
  },

  async "the key has the phases that there are, and pictures of jobs outlive a reload"({ service, browser }) {
    const page = await browser.open(service.url);
    await submit(page, sample(service, "terrain", 6000), { name: "kept.obj", clusters: 60 });
    await succeeded(page);
    await drawn(page, 60);
    const { iterations } = await (await fetch(`${service.url}/v1/jobs/${idOf(page)}/report`)).json();
    await until("the curve is whole", async () => {
      return Number(await page.getAttribute("#curve", "data-points")) === iterations.length;
    });
    const named = ["boundary", "refine", "repair", "regrow"];
    const phases = new Set(iterations.map(({ phase }) => (named.includes(phase) ? phase : "clusters")));
    assert.deepEqual(new Set(await page.locator(".key > span").allTextContents()), phases);
    const picture = `#jobs a[href$="${idOf(page)}"] img`;
    await page.waitForSelector(picture);
    await page.goto(`${service.url}/`);
    await page.reload();
    await page.waitForSelector(picture);
    await page.close();
  },

  async "a failure can be repaired after a reload, with the mesh chosen again"({ service, browser }) {
    const page = await browser.open(service.url);
    const path = sample(service, "parts", 1000);
    await submit(page, path, { name: "apart.obj", clusters: 1 });
    const failed = () => page.waitForSelector("#state[data-state=failed]");
    await failed();
    await page.reload();
    await failed();
    const [, parts] = /has (\d+) separate parts/.exec(await text(page, "#state"));
    await accessible(page, "a failure after a reload");
    const outline = () =>
      page
        .locator("label.mend")
        .first()
        .evaluate((label) => getComputedStyle(label).outlineStyle);
    assert.equal(await outline(), "none");
    await page.locator("label.mend input").first().focus();
    await page.keyboard.press("Shift+Tab");
    await page.keyboard.press("Tab");
    assert.notEqual(await outline(), "none", "it is seen which button has the focus");
    await page.setInputFiles(`label.mend:has-text('Cluster with ${parts}') input`, path);
    await succeeded(page);
    await drawn(page, Number(parts));
    await page.close();
  },

  async "jobs are compared in words, and on a phone below the tools"({ service, browser }) {
    const page = await browser.open(service.url, { viewport: { width: 390, height: 844 } });
    const path = sample(service, "cube", 600);
    for (const quality of ["fast", "default"])
      await submit(page, path, { name: "same.obj", clusters: 12, quality }).then(() => succeeded(page));
    await drawn(page, 12);
    await page.selectOption("#other", { index: 1 });
    await page.waitForSelector("#view [data-panes='2']");
    assert.deepEqual(await page.locator(".captions span").allTextContents(), ["12 clusters", "12 clusters · fast"]);
    const [tools, view] = [await page.locator("#tools").boundingBox(), await page.locator("#view").boundingBox()];
    assert.ok(view.y >= tools.y + tools.height, "the tools cover no mesh");
    await page.close();
  },
};
