// Images in superpixels, and points that come from elsewhere.
import assert from "node:assert/strict";
import { writeFileSync } from "node:fs";
import { join } from "node:path";
import { deflateSync } from "node:zlib";
import { until } from "./service.mjs";
import { accessible, fact, idOf, labels, succeeded, text } from "./steps.mjs";

export const [WIDTH, HEIGHT] = [96, 64];

/** The hues of superpixels (web/src/palette.ts). */
const HUES = [
  "241,138,142",
  "97,185,222",
  "222,199,112",
  "207,142,211",
  "150,204,131",
  "136,153,230",
  "240,166,108",
  "100,195,178",
];

/** A PNG file of squares of 16 pixels in soft colours; the first square is transparent. */
export function image(service) {
  const rows = Buffer.alloc((4 * WIDTH + 1) * HEIGHT);
  for (let y = 0; y < HEIGHT; y++) {
    for (let x = 0; x < WIDTH; x++) {
      const square = 6 * (y >> 4) + (x >> 4);
      const colour = [90 + 37 * (square % 5), 80 + 29 * (square % 6), 100 + (x >> 2), square === 0 ? 0 : 255];
      rows.set(colour, y * (4 * WIDTH + 1) + 1 + 4 * x);
    }
  }
  const header = Buffer.alloc(13);
  header.writeUInt32BE(WIDTH, 0);
  header.writeUInt32BE(HEIGHT, 4);
  header.set([8, 6], 8);
  const path = join(service.folder, "squares.png");
  const chunks = [chunk("IHDR", header), chunk("IDAT", deflateSync(rows)), chunk("IEND", Buffer.alloc(0))];
  writeFileSync(path, Buffer.concat([Buffer.from("\x89PNG\r\n\x1a\n", "latin1"), ...chunks]));
  return path;
}

function chunk(name, data) {
  const body = Buffer.concat([Buffer.from(name), data]);
  const [length, sum] = [Buffer.alloc(4), Buffer.alloc(4)];
  length.writeUInt32BE(data.length);
  sum.writeUInt32BE(checksum(body));
  return Buffer.concat([length, body, sum]);
}

/** The CRC of PNG. */
function checksum(bytes) {
  let sum = ~0;
  for (const byte of bytes) {
    sum ^= byte;
    for (let bit = 0; bit < 8; bit++) sum = (sum >>> 1) ^ (sum & 1 ? 0xedb88320 : 0);
  }
  return ~sum >>> 0;
}

export const drawnAs = async (page, layer) =>
  await until(`${layer} is drawn`, () =>
    page.evaluate((wanted) => {
      const view = document.querySelector("#view");
      return view?.dataset.layer === wanted && Number(view.querySelector("canvas")?.dataset.frames) > 0;
    }, layer),
  );

/** What the canvas shows of the image: where it is, how many pixels are light, and the colour of its middle. */
export const canvasOf = (page) => until("the canvas shows the image", () => shownBy(page));

/** The same, or null while the canvas is empty, as after a change of its size. */
const shownBy = (page) =>
  page.evaluate(
    ([width, height]) => {
      const canvas = document.querySelector("#view canvas");
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      const scale = Number(canvas.dataset.scale);
      // the image fits: it is in the middle, and its upper edge is below what is not drawn
      let top = 0;
      const middle = Math.floor(canvas.width / 2);
      while (data[4 * (top * canvas.width + middle) + 3] === 0) top++;
      if (top === canvas.height) return null;
      const left = (canvas.width - scale * width) / 2;
      const light = data.filter((_, i) => i % 4 === 0 && data[i] > 230 && data[i + 1] > 230 && data[i + 2] > 230);
      // the middle of a pixel of the image, where no line is
      const [x, y] = [left + scale * (width / 2 + 0.5), top + scale * (height / 2 + 0.5)].map(Math.floor);
      const hue = data.slice(4 * (y * canvas.width + x), 4 * (y * canvas.width + x) + 3).join();
      return { hue, scale, left, top, light: light.length, drawn: scale * scale * width * height };
    },
    [WIDTH, HEIGHT],
  );

const hex = (channels) => `#${[...channels].map((channel) => channel.toString(16).padStart(2, "0")).join("")}`;

export const images = {
  async "an image becomes superpixels, with lines around them, their means and hues"({ service, browser }) {
    const page = await browser.open(service.url);
    await page.setInputFiles("#file", image(service));
    await until("a number that suits", async () => (await page.inputValue("#clusters")) === "6");
    const methods = page.locator("#algorithm option:enabled");
    assert.deepEqual(await methods.evaluateAll((options) => options.map(({ value }) => value)), ["pml", "bb"]);
    await page.selectOption("#algorithm", "bb");
    await page.fill("#clusters", "20");
    await page.fill("#compactness", "8");
    await page.click("#submit");
    await page.waitForSelector("#state");
    await succeeded(page);
    await drawnAs(page, "photo");
    assert.equal(await page.getAttribute("#view", "data-clusters"), "20");
    assert.match(await text(page, "#state"), /^20 superpixels of 6,144 pixels/);
    const shown = await labels(service, idOf(page));
    assert.equal(new Set(shown.filter((label) => label !== 0xffffffff)).size, 20);
    const job = await (await fetch(`${service.url}/v1/jobs/${idOf(page)}`)).json();
    assert.deepEqual([job.parameters.clusters, job.parameters.compactness], [20, 8]);
    const facts = await text(page, "#energies");
    for (const fact of ["Superpixels20", "Left out256", "Explained"]) assert.ok(facts.includes(fact), facts);

    const photo = await canvasOf(page);
    // no colour of the image is as light as the lines
    assert.ok(photo.light > 200 && photo.light < 0.2 * photo.drawn, `${photo.light} light pixels of ${photo.drawn}`);
    await accessible(page, "an image");
    await page.click("[data-layer=means]");
    await drawnAs(page, "means");
    await until("means have no lines", async () => (await canvasOf(page)).light === 0, 5000);
    await page.click("[data-layer=colours]");
    await drawnAs(page, "colours");
    await until("the middle has a hue", async () => HUES.includes((await canvasOf(page)).hue), 5000);

    // a click selects the superpixel of the pixel, with the numbers of the service
    const { scale, left, top } = photo;
    const at = { x: 50, y: 40 };
    const position = { x: left + scale * (at.x + 0.5), y: top + scale * (at.y + 0.5) };
    await page.locator("#view canvas").hover({ position });
    const cluster = shown[at.y * WIDTH + at.x];
    await until("the pointer names it", async () => (await text(page, "#card")).startsWith(`Superpixel ${cluster}`));
    await page.locator("#view canvas").click({ position });
    assert.equal(await page.getAttribute("#picked", "data-cluster"), String(cluster));
    const table = await (await fetch(`${service.url}/v1/jobs/${job.id}/clusters?format=csv`)).text();
    const row = table.split("\n")[cluster + 1].split(",");
    assert.equal(await fact(page, "pixels"), row[1]);
    assert.equal(await fact(page, "neighbours"), row[4]);
    const means = await page.evaluate(
      async ([url, x, y]) => {
        const image = await createImageBitmap(await (await fetch(url)).blob());
        const context = new OffscreenCanvas(1, 1).getContext("2d");
        context.drawImage(image, -x, -y);
        return [...context.getImageData(0, 0, 1, 1).data.subarray(0, 3)];
      },
      [job.urls.means, at.x, at.y],
    );
    assert.equal(await fact(page, "colour"), hex(means));

    // the wheel zooms, a drag moves, 0 shows the whole
    await page.mouse.wheel(0, -400);
    const zoomed = () => page.getAttribute("#view canvas", "data-scale").then(Number);
    await until("it is larger", async () => (await zoomed()) > 1.5 * scale);
    await page.locator("#view canvas").press("0");
    await until("the whole is seen", async () => (await zoomed()) === scale);

    // the photo is gone with the visit, and the list has a picture of its means
    await page.click("[data-layer=photo]");
    await page.reload();
    await drawnAs(page, "means");
    assert.equal(await page.locator("[data-layer=photo]").count(), 0);
    assert.equal(await page.getAttribute("#picked", "data-cluster"), String(cluster));
    const other = await browser.open(service.url);
    await other.waitForSelector(`#jobs a[href$="${job.id}"] img`);
    for (const opened of [page, other]) await opened.close();
  },

  async "an image is clustered again, and files and commands are its own"({ service, browser }) {
    const page = await browser.open(service.url, { permissions: ["clipboard-read", "clipboard-write"] });
    await page.setInputFiles("#file", image(service));
    await page.selectOption("#algorithm", "bb");
    await page.fill("#clusters", "9999");
    await page.click("#submit");
    await until("the job fails", async () => (await text(page, "#state")).startsWith("Failed: The image has 5888 "));
    await page.click(".mend");
    await until("another job succeeds", async () => (await page.getAttribute("#view", "data-clusters")) === "5888");
    await page.fill("#again-clusters", "12");
    await page.fill("#again-compactness", "30");
    await page.click("#again button");
    await until("it has other numbers", async () => (await page.getAttribute("#view", "data-clusters")) === "12");
    assert.match(await text(page, ".manner"), /^Superpixels · compactness 30$/);
    await drawnAs(page, "photo");
    await page.click("text=Downloads");
    for (const [name, extension] of [
      ["labels", "png"],
      ["labels", "npy"],
      ["means", "png"],
      ["clusters", "csv"],
      ["report", "json"],
    ]) {
      const [file] = await Promise.all([
        page.waitForEvent("download"),
        page.click(`[aria-label="Download ${name} as ${extension}"]`),
      ]);
      assert.equal(file.suggestedFilename(), `squares-${name}.${extension}`);
    }
    assert.equal(await page.locator("[aria-label='Download graph as json']").count(), 0, "it was not asked for");
    for (const [button, words] of [
      ["curl", /outputs=means%2Cclusters\.csv%2Cclusters\.json&clusters=12.*compactness=30/],
      ["command", /^tesserae cluster squares\.png .*--clusters 12 .*--compactness 30 .*--means means\.png/],
      ["python", /tesserae_mesh\.superpixels\(image, n=12, .*compactness=30\)/],
    ]) {
      await page.click(`#copy-${button}`);
      const isCopied = async () => words.test(await page.evaluate(() => navigator.clipboard.readText()));
      await until(`${button} is copied`, isCopied, 5000);
    }
    await page.close();
  },

  async "a photo that a tag turns is shown in the order of its pixels, which labels have"({ service, browser }) {
    const page = await browser.open(service.url);
    const jpeg = await page.evaluate(
      async ([width, height]) => {
        const canvas = new OffscreenCanvas(width, height);
        const context = canvas.getContext("2d");
        context.fillStyle = "#c04020";
        context.fillRect(0, 0, width / 2, height);
        return [...new Uint8Array(await (await canvas.convertToBlob({ type: "image/jpeg" })).arrayBuffer())];
      },
      [WIDTH, HEIGHT],
    );
    // one entry of EXIF: orientation 6, a quarter turn
    const tag = [0x4d, 0x4d, 0, 42, 0, 0, 0, 8, 0, 1, 1, 0x12, 0, 3, 0, 0, 0, 1, 0, 6, 0, 0, 0, 0, 0, 0];
    const exif = [0xff, 0xe1, 0, 8 + tag.length, ...Buffer.from("Exif\0\0"), ...tag];
    const path = join(service.folder, "turned.jpg");
    writeFileSync(path, Buffer.from([...jpeg.slice(0, 2), ...exif, ...jpeg.slice(2)]));
    await page.setInputFiles("#file", path);
    await until("its size is known", async () => (await page.inputValue("#clusters")) === "6");
    await page.click("#submit");
    await page.waitForSelector("#state");
    await succeeded(page);
    await drawnAs(page, "photo");
    await page.close();
  },

  async "points from elsewhere have numbers and files, and no picture"({ service, browser }) {
    const head = `{'descr': '<f4', 'fortran_order': False, 'shape': (100, 2), }`.padEnd(117) + "\n";
    const numbers = Float32Array.from({ length: 200 }, (_, i) => (i * 37) % 101);
    const body = Buffer.concat([
      Buffer.from("\x93NUMPY\x01\x00", "latin1"),
      Buffer.from([head.length, 0]),
      Buffer.from(head),
      Buffer.from(numbers.buffer),
    ]);
    const headers = { "content-type": "application/x-npy" };
    const url = `${service.url}/v1/jobs?clusters=7&graph=knn:6&outputs=clusters.csv`;
    const job = await (await fetch(url, { method: "POST", headers, body })).json();
    const page = await browser.open(service.url, {}, undefined, `/#/jobs/${job.id}`);
    await succeeded(page);
    await until("it has numbers", async () => (await page.locator("#energies").count()) === 1);
    assert.match(await text(page, "#energies"), /Items100.*Columns2.*Neighboursknn:6.*Clusters7/);
    assert.match(await text(page, "#view"), /no picture/);
    assert.match(await text(page, "#state"), /^7 clusters of 100 items/);
    await page.click("text=Downloads");
    await page.waitForSelector("[aria-label='Download clusters as csv']");
    await accessible(page, "points");
    await page.close();
  },
};
