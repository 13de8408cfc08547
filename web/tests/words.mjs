// What colours, words and small pictures say: that they are those of what is shown.
import assert from "node:assert/strict";
import { copyFileSync, existsSync, readFileSync } from "node:fs";
import { basename, join } from "node:path";
import { until } from "./service.mjs";
import { accessible, drawn, fact, idOf, labels, meshes, run, sample, submit, succeeded, text } from "./steps.mjs";

/** The colour that an element has; one that was replaced meanwhile has none. */
const colourOf = (locator) =>
  until("it has a colour", () => locator.evaluate((element) => getComputedStyle(element).backgroundColor));

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
    let go;
    const held = new Promise((resolve) => (go = resolve));
    await page.route(/\.glb$|format=glb/, async (route) => (await held, await route.continue()));
    await page.reload();
    // before the mesh is there
    await page.waitForSelector(`#picked[data-cluster='${behind}']`);
    assert.match(page.url(), new RegExp(`cluster=${behind}$`));
    go();
    await drawn(page, 20);
    await until("it is in the middle", async () => (await middle()) === behind);
    await page.close();
  },

  async "a job can be taken along as link, curl, command and Python"({ service, browser }) {
    const page = await browser.open(service.url, { permissions: ["clipboard-read", "clipboard-write"] });
    await submit(page, sample(service, "terrain", 6000), { name: "hills.obj", clusters: 60 });
    await succeeded(page);
    await page.fill("#again-clusters", "25");
    await page.click("#again button");
    await drawn(page, 25);
    const begins = { link: service.url, curl: "curl ", command: "tesserae ", python: "import " };
    const copied = async (name) => {
      await page.click(`#copy-${name}`);
      return await until(`${name} is copied`, async () => {
        const text = await page.evaluate(() => navigator.clipboard.readText());
        return text.startsWith(begins[name]) && text;
      });
    };
    assert.equal(await copied("link"), page.url());
    // the job came from the kept mesh, which is PLY, and the file of its name is OBJ
    const name = `hills; "2", it's.obj`;
    copyFileSync(sample(service, "terrain", 6000), join(service.folder, "hills.obj"));
    const made = await run(await copied("curl"), service);
    assert.deepEqual(await labels(service, made), await labels(service, idOf(page)));
    assert.match(await copied("command"), /^tesserae cluster hills\.obj --algorithm bb --clusters 25/);
    assert.match(await copied("python"), /tesserae_mesh\.cluster\("hills\.obj", algorithm="bb", clusters=25/);
    // a name that a shell and curl read in their own ways
    await submit(page, sample(service, "sphere", 500), { name, clusters: 5 });
    await succeeded(page);
    copyFileSync(sample(service, "sphere", 500), join(service.folder, name));
    await run(await copied("curl"), service);
    const duck = ["Duck.gltf", "Duck0.bin"].map((file) => join(meshes ?? "", "gltf/Duck", file));
    if (meshes && duck.every(existsSync)) {
      await page.setInputFiles("#file", duck);
      await page.fill("#clusters", "30");
      await page.click("#submit");
      await until("the duck is open", async () => (await text(page, "#job-title")) === "Duck.gltf");
      await succeeded(page);
      for (const path of duck) copyFileSync(path, join(service.folder, basename(path)));
      await run(await copied("curl"), service);
    }
    await page.close();
  },

  async "copied commands name no folder, no hidden file and no flag"({ service, browser }) {
    const page = await browser.open(service.url, { permissions: ["clipboard-read", "clipboard-write"] }, (page) =>
      page.route(/\/v1\/jobs\/[0-9a-f-]+$/, async (route) => {
        const response = await route.fetch();
        const job = await response.json();
        const buffers = ["a/b.bin", "/etc/passwd", "../c.bin", ".ssh/id_rsa", "C:\\d.bin"];
        Object.assign(job.mesh, { file_name: "/home/x/.ssh/-id\n_rsa.obj", buffers });
        await route.fulfill({ response, json: job });
      }),
    );
    await submit(page, sample(service, "sphere", 500), { name: "named.obj", clusters: 5 });
    await succeeded(page);
    for (const [name, words] of [
      ["curl", ` -F 'mesh=@"./-id_rsa.obj"' -F 'buffer=@"a/b.bin"' 'http`],
      ["command", "tesserae cluster ./-id_rsa.obj --algorithm"],
      ["python", 'tesserae_mesh.cluster("./-id_rsa.obj", '],
    ]) {
      await page.click(`#copy-${name}`);
      const copied = () => page.evaluate(() => navigator.clipboard.readText());
      await until(`${name} is copied`, async () => (await copied()).includes(words));
    }
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
    const named = {
      boundary: "settling borders",
      refine: "refining borders",
      repair: "joining pieces",
      regrow: "growing anew",
    };
    const phases = new Set(iterations.map(({ phase }) => named[phase] ?? "moving whole clusters"));
    assert.deepEqual(new Set(await page.locator(".key > span").allTextContents()), phases);
    const picture = `#jobs a[href$="${idOf(page)}"] img`;
    await page.waitForSelector(picture);
    await page.goto(`${service.url}/`);
    await page.reload();
    await page.waitForSelector(picture);
    await page.emulateMedia({ colorScheme: "dark" });
    const corner = () =>
      page.evaluate((selector) => {
        const image = document.querySelector(selector);
        const context = new OffscreenCanvas(1, 1).getContext("2d");
        if (image) context.drawImage(image, 0, 0);
        return Array.from(context.getImageData(0, 0, 1, 1).data);
      }, picture);
    await until("the dark page has a dark one", async () => {
      const [red, , , alpha] = await corner();
      return alpha === 255 && red < 100;
    });
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
    const ratioOf = async () =>
      (await (await fetch(`${service.url}/v1/jobs/${idOf(page)}/report`)).json()).energy.hexagon_ratio;
    await submit(page, sample(service, "parts", 1000), { name: "apart.obj", clusters: 20 });
    await succeeded(page);
    await drawn(page, 20);
    assert.ok((await ratioOf()) > 1);
    assert.ok(!(await text(page, "#energies")).includes("honeycomb"));
    const path = sample(service, "cube", 600);
    for (const quality of ["fast", "default"])
      await submit(page, path, { name: "same.obj", clusters: 12, quality }).then(() => succeeded(page));
    await drawn(page, 12);
    assert.ok((await ratioOf()) <= 1);
    assert.ok((await text(page, "#energies")).includes("honeycomb"));
    await page.selectOption("#other", { index: 1 });
    await page.waitForSelector("#view [data-panes='2']");
    assert.deepEqual(await page.locator(".captions span").allTextContents(), ["12 clusters", "12 clusters · fast"]);
    const [tools, view] = [await page.locator("#tools").boundingBox(), await page.locator("#view").boundingBox()];
    assert.ok(view.y >= tools.y + tools.height, "the tools cover no mesh");
    await page.close();
  },
};
