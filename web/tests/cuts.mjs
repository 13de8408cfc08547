// An image in any number of superpixels, by the slider of meshes.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { join, resolve } from "node:path";
import { HEIGHT, WIDTH, canvasOf, drawnAs, image } from "./images.mjs";
import { until } from "./service.mjs";
import { accessible, binary, drawn, fact, idOf, labels, picture, succeeded, text } from "./steps.mjs";

const FREE = 0xffffffff;

/** Pixels that take part. */
const OPAQUE = WIDTH * HEIGHT - 256;

/** Sends the image of squares for a slider that begins at 20. */
async function send(page, service) {
  await page.setInputFiles("#file", image(service));
  await page.selectOption("#algorithm", "pml");
  await page.fill("#clusters", "20");
  await page.click("#submit");
  await page.waitForSelector("#state");
  await succeeded(page);
  await drawn(page, 20);
}

async function cutAt(page, clusters) {
  await page.fill("#level-number", String(clusters));
  await page.locator("#level-number").blur();
  await drawn(page, clusters);
  await until("the address has the cut", () => new URL(page.url()).hash.includes(`clusters=${clusters}`));
}

/** Colours in the middle of every pixel of the image: on the canvas, and in an image of the service. */
const colours = (page, place, url) =>
  page.evaluate(
    async ([width, height, { scale, left, top }, url]) => {
      const read = ({ data, width }, x, y) => data.slice(4 * (y * width + x), 4 * (y * width + x) + 4).join();
      const canvas = document.querySelector("#view canvas");
      const shown = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      const context = new OffscreenCanvas(width, height).getContext("2d");
      context.drawImage(await createImageBitmap(await (await fetch(url)).blob()), 0, 0);
      const means = context.getImageData(0, 0, width, height);
      const at = (pixel, from) => Math.floor(from + scale * (pixel + 0.5));
      return Array.from({ length: width * height }, (_, i) => {
        const [x, y] = [i % width, Math.floor(i / width)];
        return [read(shown, at(x, left), at(y, top)), read(means, x, y)];
      });
    },
    [WIDTH, HEIGHT, place, url],
  );

export const cuts = {
  async "the slider cuts an image into the superpixels that the service gives, masked pixels left out"(context) {
    const { service, browser } = context;
    const page = await browser.open(service.url);
    await send(page, service);
    const id = idOf(page);
    assert.match(await text(page, "#state"), /^20 superpixels of 6,144 pixels/);
    const job = await (await fetch(`${service.url}/v1/jobs/${id}`)).json();
    assert.deepEqual([job.parameters.levels, job.parameters.clusters, job.keep_mesh], [[20], null, true]);
    assert.equal(await page.getAttribute("#level-number", "max"), String(OPAQUE));
    await drawnAs(page, "photo");
    const place = await canvasOf(page);
    await until("the merges are here", async () => (await page.locator("#cluster-table tbody tr").count()) > 0);
    await page.click("[data-layer=means]");

    // as a hand drags it: every frame has another cut, and none of them takes a request
    const asked = [];
    page.on("request", (request) => request.url().includes(`${id}/labels?`) && asked.push(request.url()));
    await until("cuts are made here", async () => {
      await cutAt(page, 25);
      await cutAt(page, 24);
      return asked.splice(0).length === 0;
    });
    const seen = await page.evaluate(async () => {
      const [range, found] = [document.querySelector("#level"), new Set()];
      for (let frame = 0; frame < 30; frame++) {
        range.value = String(300 + 10 * frame);
        range.dispatchEvent(new Event("input"));
        await new Promise(requestAnimationFrame);
        await new Promise(requestAnimationFrame);
        found.add(document.querySelector("#view").dataset.clusters);
      }
      return found.size;
    });
    assert.ok(seen > 25, `${seen} cuts in 30 moves`);

    for (const clusters of [7, 133]) {
      await cutAt(page, clusters);
      const cut = await labels(service, id, clusters);
      assert.equal(new Set(cut.filter((label) => label !== FREE)).size, clusters);
      const url = `/v1/jobs/${id}/means?clusters=${clusters}`;
      await until("every pixel has the mean colour that the service gives", async () => {
        const found = await colours(page, place, url);
        return found.every(([drawn, given]) => drawn === given);
      });
      const counts = new Uint32Array(clusters);
      for (const label of cut) if (label !== FREE) counts[label]++;
      await page.evaluate(() => (document.querySelector("details:has(#cluster-table)").open = true));
      const rows = await page
        .locator("#cluster-table tbody tr")
        .evaluateAll((rows) => rows.map((row) => [...row.cells].map((cell) => cell.textContent)));
      assert.equal(rows.length, Math.min(20, clusters));
      for (const [name, pixels] of rows)
        assert.equal(Number(pixels.replace(",", "")), counts[Number(name.split(" ")[1])], name);
    }
    assert.deepEqual(asked, []);
    assert.equal(await page.locator("#cut-energy").textContent(), await energyAt(service, id, 133));
    await accessible(page, "an image with a slider");
    await picture(page, "page-superpixels.png");

    // keys move it as they move any slider
    await page.locator("#level").focus();
    await page.keyboard.press("Home");
    await drawn(page, job.result.clusters);
    await page.keyboard.press("End");
    await drawn(page, OPAQUE);
    await page.close();
  },

  async "a cut of an image is in the address, its numbers, files and commands"({ service, browser }) {
    const page = await browser.open(service.url, { permissions: ["clipboard-read", "clipboard-write"] });
    await send(page, service);
    const id = idOf(page);
    const { scale, left, top } = await canvasOf(page);
    const [x, y] = [50, 40];
    const position = { x: left + scale * (x + 0.5), y: top + scale * (y + 0.5) };
    await page.locator("#view canvas").click({ position });
    const selected = (await labels(service, id, 20))[y * WIDTH + x];
    assert.equal(await page.getAttribute("#picked", "data-cluster"), String(selected));

    /** The numbers of the selected one are those of the service's table at a cut. */
    const isTold = async (clusters) => {
      const table = await (await fetch(`${service.url}/v1/jobs/${id}/clusters?format=csv&clusters=${clusters}`)).text();
      const row = table.split("\n")[selected + 1].split(",");
      await until("its numbers are there", async () => (await page.locator("[data-fact=neighbours]").count()) === 1);
      assert.deepEqual([await fact(page, "pixels"), await fact(page, "neighbours")], [row[1], row[4]]);
    };
    await isTold(20);
    await cutAt(page, 40);
    assert.equal(await page.getAttribute("#picked", "data-cluster"), String(selected));
    await isTold(40);

    // the photo is kept, so a reload and a link show the same
    await page.reload();
    await drawn(page, 40);
    await drawnAs(page, "photo");
    await isTold(40);
    assert.equal(await page.inputValue("#level-number"), "40");
    const other = await browser.open(service.url);
    await other.waitForSelector(`#jobs a[href$="${id}"] img`);
    await other.close();

    await page.click("text=Downloads");
    for (const [name, extension] of [
      ["labels", "png"],
      ["means", "png"],
      ["clusters", "json"],
      ["graph", "graphml"],
    ]) {
      const [file] = await Promise.all([
        page.waitForEvent("download"),
        page.click(`[aria-label="Download ${name} as ${extension}"]`),
      ]);
      assert.equal(file.suggestedFilename(), `squares-${name}-40.${extension}`);
      const given = await fetch(`${service.url}/v1/jobs/${id}/${name}?format=${extension}&clusters=40`);
      assert.deepEqual(readFileSync(await file.path()), Buffer.from(await given.arrayBuffer()), name);
    }
    const copied = async (button, words) => {
      await page.click(`#copy-${button}`);
      const read = () => page.evaluate(() => navigator.clipboard.readText());
      await until(`${button} is copied`, async () => words.test(await read()));
      return await read();
    };
    await copied("curl", /algorithm=pml&keep_mesh=true&levels=20.*compactness=10/);
    await copied("python", /Hierarchy\.load\("hierarchy\.tsr"\)\.cut\(40\)\.labels/);
    const command = await copied("command", /--levels 20 .*\ntesserae cut hierarchy\.tsr --clusters 40/);
    const here = { cwd: service.folder, timeout: 60_000 };
    execFileSync("sh", ["-c", command.replaceAll("tesserae c", `${resolve(binary)} c`)], here);
    const given = await fetch(`${service.url}/v1/jobs/${id}/labels?format=png&clusters=40`);
    assert.deepEqual(readFileSync(join(service.folder, "labels.png")), Buffer.from(await given.arrayBuffer()));

    // once more, without the file in this visit: a flat job of another number
    await page.fill("#again-clusters", "12");
    await page.click("#again button");
    await until("it is flat", async () => (await page.getAttribute("#view", "data-clusters")) === "12");
    assert.equal(await page.locator("#level").count(), 0);
    await page.close();
  },
};

/** The energy at a cut, in as many digits as the page writes. */
async function energyAt(service, id, clusters) {
  const answer = await fetch(`${service.url}/v1/jobs/${id}/labels?format=bin&clusters=${clusters}`);
  return String(Number(Number(answer.headers.get("tesserae-energy")).toPrecision(4)));
}
