// Jobs without a result, and what is said for a while only: failures, cancellations, notices.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { look } from "./browser.mjs";
import { until } from "./service.mjs";
import { accessible, drawn, drop, fact, idOf, sample, submit, succeeded, text } from "./steps.mjs";

const failed = (page) => page.waitForSelector("#state[data-state=failed]");

/** Whether an element is below the words of the job, and close to them. */
const isUnderWords = async (page, selector) => {
  const [words, element] = [await page.locator("#state").boundingBox(), await page.locator(selector).boundingBox()];
  return element.y >= words.y + words.height && element.y < words.y + words.height + 40 && element.x < words.x + 40;
};

export const ends = {
  async "a job that fails shows its mesh, and what repairs it under the words"({ service, browser }) {
    const page = await browser.open(service.url, { viewport: { width: 1280, height: 720 } });
    await submit(page, sample(service, "parts", 1000), { name: "asunder.obj", clusters: 1 });
    await failed(page);
    await page.waitForSelector("#preview canvas[data-frames]");
    assert.ok(await isUnderWords(page, "button.mend >> nth=0"));
    assert.ok(await page.isHidden("#inspector"), "there is nothing to inspect");
    await accessible(page, "a failure with its mesh");
    await page.reload();
    await failed(page);
    assert.match(await text(page, ".mend >> nth=0"), /^Choose the mesh, cluster with \d+$/);
    assert.ok(await isUnderWords(page, "label.mend >> nth=0"));
    await page.click("#remove");
    await until("it is not in the list", async () => !(await text(page, "#jobs")).includes("asunder"));
    await page.close();
  },

  async "the sample of a terrain lies, whose rim is rough"({ service, browser }) {
    const page = await browser.open(service.url);
    await page.click("[data-sample=terrain]");
    await page.waitForSelector("#state");
    await succeeded(page);
    await page.waitForSelector("#view canvas[data-frames]");
    assert.equal(await page.getAttribute("#view canvas", "data-up"), "z");
    await page.close();
  },

  async "the slider and the tools cover no part of a mesh"({ service, browser }) {
    const page = await browser.open(service.url, { viewport: { width: 1280, height: 720 } });
    await submit(page, sample(service, "sphere", 500), { name: "uncovered.obj", algorithm: "pml" });
    await succeeded(page);
    await page.waitForSelector("#view canvas[data-frames]");
    const covered = async () => {
      const seen = [await look(page, "#dock"), await look(page, "#tools")];
      return seen.map(({ hues }) => hues > 0);
    };
    // what they cover is looked at
    for (const over of [".level", "#tools"])
      await page.locator(over).evaluate((element) => (element.style.opacity = 0));
    assert.deepEqual(await covered(), [false, false]);
    for (const size of [
      { width: 1000, height: 600 },
      { width: 1280, height: 720 },
    ]) {
      await page.setViewportSize(size);
      assert.deepEqual(await covered(), [false, false], `at a width of ${size.width}`);
    }
    await page.locator("#view canvas").focus();
    for (let press = 0; press < 5; press++) await page.keyboard.press("+");
    await until("a mesh below them is noticed", async () => (await covered()).every(Boolean));
    await page.close();
  },

  async "one cluster of a closed mesh has no border to measure"({ service, browser }) {
    const page = await browser.open(service.url);
    await submit(page, sample(service, "sphere", 500), { name: "whole.obj", clusters: 1 });
    await succeeded(page);
    await drawn(page, 1);
    await page.goto(`${page.url()}?cluster=0`);
    await page.reload();
    await page.waitForSelector("#picked [data-fact=neighbours]");
    assert.equal(await fact(page, "neighbours"), "0");
    assert.doesNotMatch(await text(page, "#picked"), /NaN/);
    await page.close();
  },

  async "an address that is entered is not changed by the page that it leaves"({ service, browser }) {
    const page = await browser.open(service.url);
    await submit(page, sample(service, "sphere", 500), { name: "left.obj", clusters: 9 });
    await succeeded(page);
    await drawn(page, 9);
    await page.click("text=Table of clusters");
    const row = "#cluster-table tbody tr:first-child";
    await page.waitForSelector(row);
    // both before the event that the address has changed
    const clicked = await page.evaluate((row) => {
      const button = document.querySelector(`${row} button`);
      location.hash = `${location.hash.split("?")[0]}?cluster=7`;
      button.click();
      return Number(/\d+/.exec(button.textContent)[0]);
    }, row);
    assert.notEqual(clicked, 7);
    await page.waitForSelector("#picked[data-cluster='7'] [data-fact=neighbours]");
    assert.match(page.url(), /cluster=7$/);
    await page.close();
  },

  async "a notice goes with what it was of"({ service, browser }) {
    const page = await browser.open(service.url);
    await page.goto(`${service.url}/#/jobs/00000000-0000-4000-8000-000000000000`);
    await until("the job is not there", async () => /no such job/.test(await text(page, "#notice")));
    await page.click("text=Cluster a mesh");
    await until("the notice is gone", () => page.isHidden("#notice"));
    await page.close();
  },

  async "a menu closes by Escape and by a click elsewhere"({ service, browser }) {
    const page = await browser.open(service.url);
    await submit(page, sample(service, "sphere", 500), { name: "menu.obj", clusters: 5 });
    await succeeded(page);
    await page.goto(`${page.url()}?cluster=2`);
    await page.reload();
    await page.waitForSelector("#picked[data-cluster='2']");
    for (const close of [() => page.keyboard.press("Escape"), () => page.click(".manner")]) {
      await page.click(".menu summary");
      await page.waitForSelector("#remove");
      await close();
      await until("it is closed", () => page.isHidden("#remove"));
    }
    assert.equal(await page.getAttribute("#picked", "data-cluster"), "2");
    await page.keyboard.press("Escape");
    await page.waitForSelector("#picked[data-cluster='']", { state: "attached" });
    await page.close();
  },

  async "what is dropped is seen at once, and the whole window takes it"({ service, browser }) {
    const page = await browser.open(service.url, { knot: true });
    assert.ok(await page.isHidden("#submit"), "there is nothing to cluster");
    const drag = async (add) => {
      const dataTransfer = await page.evaluateHandle(add);
      await page.dispatchEvent("main", "dragover", { dataTransfer });
    };
    const marked = () => page.evaluate(() => getComputedStyle(document.body, "::after").position === "fixed");
    await drag(() => {
      const transfer = new DataTransfer();
      transfer.setData("text/plain", "words");
      return transfer;
    });
    assert.ok(!(await marked()), "a text is no file");
    await drag(() => {
      const transfer = new DataTransfer();
      transfer.items.add(new File(["v"], "a.obj"));
      return transfer;
    });
    assert.ok(await marked());
    const path = sample(service, "sphere", 500);
    await drop(page, path, "seen.obj");
    assert.ok(!(await marked()));
    await page.waitForSelector("#first-visit #preview canvas[data-frames]");
    assert.equal((await look(page, "#preview")).hues, 0, "it is grey");
    assert.equal(await text(page, "#first-visit h2"), "seen.obj");
    await accessible(page, "what was dropped");
    await page.click("#submit");
    await page.waitForSelector("#state");
    await succeeded(page);
    // on the page of a job, too
    await drop(page, path, "next.obj");
    await page.waitForSelector("#first-visit h2:has-text('next.obj')");
    await page.goBack();
    await succeeded(page);
    await page.click("h1 a");
    await page.waitForSelector("#first-visit h2:has-text('next.obj')");
    await page.close();
  },

  async "what cannot become a job is said before it is sent"({ service, browser }) {
    const page = await browser.open(service.url);
    let posts = 0;
    page.on("request", (request) => (posts += request.method() === "POST"));
    const file = (name, text) => ({ name, mimeType: "model/mesh", buffer: Buffer.from(text) });
    const triangle = file("one.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    await page.setInputFiles("#file", [triangle, file("README.md", "# one"), file("two.obj", triangle.buffer)]);
    assert.equal(await text(page, "#notice"), "README.md is no mesh or image that is known here.");
    assert.equal(await text(page, "#submit"), "Cluster 2 meshes");
    await page.setInputFiles("#file", file("none.ply", ""));
    await until("it is empty", async () => (await text(page, "#notice")) === "none.ply is empty.");
    assert.ok(await page.isDisabled("#submit"));
    await page.setInputFiles("#file", triangle);
    await page.selectOption("#algorithm", "bb");
    await page.fill("#clusters", "2");
    await page.click("#submit");
    await until("there are too many", async () =>
      /^one\.obj has 1 face, and there are at most as many clusters\.$/.test(await text(page, "#notice")),
    );
    assert.equal(posts, 0);
    await page.fill("#clusters", "1");
    await page.click("#submit");
    await page.waitForSelector("#state");
    assert.equal(posts, 1);
    await page.close();
  },

  async "the first visit shows the number of its address"({ service, browser }) {
    const page = await browser.open(service.url, { knot: true });
    await page.waitForSelector("#knot canvas[data-frames]");
    await page.fill("#level-number", "77");
    await page.keyboard.press("Enter");
    await until("it is in the address", () => page.url().endsWith("#/?clusters=77"));
    await page.reload();
    await page.waitForSelector("#knot[data-clusters='77']");
    assert.equal(await page.inputValue("#level-number"), "77");
    await page.close();
  },

  async "the line between two jobs is where the address says"({ service, browser }) {
    const page = await browser.open(service.url);
    const path = sample(service, "sphere", 500);
    for (const quality of ["fast", "default"])
      await submit(page, path, { name: "parted.obj", clusters: 12, quality }).then(() => succeeded(page));
    await page.selectOption("#other", { index: 1 });
    await page.check("#wipe");
    await page.fill("#line", "0.295");
    await until("it is in the address", () => page.url().includes("line=0.295"));
    await page.reload();
    await page.waitForSelector(".captions.parted");
    assert.equal(await page.inputValue("#line"), "0.295");
    const line = (of) => page.evaluate((of) => getComputedStyle(document.querySelector(".captions"), of).left, of);
    const { width } = await page.locator(".captions").boundingBox();
    assert.ok(Math.abs(parseFloat(await line("::before")) - 0.295 * width) < 2);
    await page.close();
  },

  async "a job that was cancelled can be run again, after a reload with the mesh chosen again"({ service, browser }) {
    const page = await browser.open(service.url);
    const slow = sample(service, "knot", 200_000);
    await submit(page, slow, { name: "stopped.obj", algorithm: "ml" });
    await page.click("#remove:has-text('Cancel')");
    await page.waitForSelector("#state[data-state=cancelled]");
    await page.waitForSelector("button.mend:has-text('Cluster again')");
    await page.reload();
    await page.waitForSelector("label.mend:has-text('Choose the mesh, cluster again')");
    await accessible(page, "a cancelled job");
    const before = page.url();
    await page.setInputFiles("label.mend input", sample(service, "sphere", 500));
    await until("another job is open", () => page.url() !== before);
    await succeeded(page);
    await page.close();
  },

  async "a job that is deleted elsewhere is said"({ service, browser }) {
    const page = await browser.open(service.url);
    await submit(page, sample(service, "sphere", 500), { name: "elsewhere.obj", clusters: 5 });
    await succeeded(page);
    await fetch(`${service.url}/v1/jobs/${idOf(page)}`, { method: "DELETE" });
    await page.waitForSelector(".nothing h2");
    assert.match(await text(page, "#notice"), /no such job/);
    await page.close();
  },

  async "warnings are sentences, and no errors"({ service, browser }) {
    const page = await browser.open(service.url);
    const body = Buffer.from(`${readFileSync(sample(service, "sphere", 500))}f 1 1 2\nf 1 1 3\n`);
    const headers = { prefer: "wait=60" };
    const query = "format=obj&clusters=20&keep_mesh=true";
    const answer = await fetch(`${service.url}/v1/jobs?${query}`, { method: "POST", headers, body });
    const { id } = await answer.json();
    await page.goto(`${service.url}/#/jobs/${id}`);
    const warning = page.locator(".warning").first();
    assert.match(await warning.textContent(), /^2 degenerate faces.*\.$/);
    const colour = (element) => getComputedStyle(element).color;
    assert.equal(await warning.evaluate(colour), await page.locator(".facts dd").first().evaluate(colour));
    await page.close();
  },

  async "the picture, a picked cluster and the chart are on one screen, with the main file"({ service, browser }) {
    const page = await browser.open(service.url, { viewport: { width: 1280, height: 720 } });
    await submit(page, sample(service, "terrain", 6000), { name: "screen.obj", clusters: 60 });
    await succeeded(page);
    await drawn(page, 60);
    await page.goto(`${page.url()}?cluster=7`);
    await page.reload();
    await page.waitForSelector("#picked[data-cluster='7'] [data-fact=perimeter]");
    await page.waitForSelector("#curve[data-points]");
    for (const part of ["#view canvas", "#picked", "#curve", "#glb"]) {
      const { x, y, width, height } = await page.locator(part).boundingBox();
      assert.ok(x >= 0 && y >= 0 && x + width <= 1280 && y + height <= 720, `${part} is in sight`);
    }
    const [download] = await Promise.all([page.waitForEvent("download"), page.click("#glb")]);
    assert.equal(readFileSync(await download.path(), "latin1").slice(0, 4), "glTF");
    assert.equal(download.suggestedFilename(), "screen-mesh.glb");
    await page.close();
  },

  async "a phone has targets for fingers, and words for them"({ service, browser }) {
    const page = await browser.open(service.url, {
      viewport: { width: 390, height: 844 },
      hasTouch: true,
      isMobile: true,
    });
    await submit(page, sample(service, "terrain", 6000), { name: "phone.obj", clusters: 60 });
    await succeeded(page);
    await page.waitForSelector("#view canvas[data-frames]");
    await until("it says what a tap does", async () => /^Tap a cluster/.test(await text(page, "#picked p")));
    await page.click("summary:has-text('Downloads')");
    await page.waitForSelector("#downloads button");
    const low = await page.evaluate(() =>
      [...document.querySelectorAll("button, select, summary, .button, input:not([type=file], [type=checkbox])")]
        .filter((element) => element.checkVisibility() && !element.closest("table"))
        .filter((element) => element.getBoundingClientRect().height < 40)
        .map((element) => element.outerHTML),
    );
    assert.deepEqual(low, []);
    await page.close();
  },

  async "a running job is accessible, there is a picture for links, and no field for a token"({ service, browser }) {
    const page = await browser.open(service.url, { reducedMotion: "reduce" });
    assert.ok(await page.isHidden("#token-form"));
    const shared = await page.getAttribute("meta[property='og:image']", "content");
    const answer = await fetch(new URL(shared, service.url));
    assert.deepEqual([answer.status, answer.headers.get("content-type")], [200, "image/jpeg"]);
    // it runs until it is deleted
    await submit(page, sample(service, "knot", 200_000), { name: "runs.obj", algorithm: "ml" });
    await page.waitForSelector("#preview[data-shown]");
    await accessible(page, "a running job");
    assert.equal(await page.getAttribute("#state", "data-state"), "running");
    await fetch(`${service.url}/v1/jobs/${idOf(page)}`, { method: "DELETE" });
    await page.close();
  },
};
