// What the page shows at first sight, and what every control changes.
import assert from "node:assert/strict";
import { existsSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { look } from "./browser.mjs";
import { until } from "./service.mjs";
import {
  accessible,
  drawn,
  fact,
  hold,
  idOf,
  labels,
  meshes,
  pass,
  picture,
  remove,
  sample,
  submit,
  succeeded,
  text,
} from "./steps.mjs";

const address = (page) => new URLSearchParams(page.url().split("?")[1] ?? "");
const middle = async (page, selector) => {
  const { width, height } = await page.locator(selector).boundingBox();
  return { x: width / 2, y: height / 2 };
};

export const design = {
  async "the first visit shows a knot in clusters that turns, and the slider cuts it"({ service, browser }) {
    const page = await browser.open(service.url, { viewport: { width: 1280, height: 720 }, knot: true });
    await page.waitForSelector("#knot canvas[data-frames]");
    assert.ok((await look(page, "#knot")).hues > 6, "it has the hues of clusters");
    const frames = async () => Number(await page.getAttribute("#knot canvas", "data-frames"));
    const before = await frames();
    await until("it turns", async () => (await frames()) > before + 3);
    await page.locator("#level").focus();
    for (const [key, clusters] of [
      ["Home", "1"],
      ["End", "5000"],
    ]) {
      await page.keyboard.press(key);
      await until(`${clusters} clusters`, async () => (await page.getAttribute("#knot", "data-clusters")) === clusters);
      assert.match(
        await text(page, ".cut"),
        new RegExp(`^${Number(clusters).toLocaleString("en")} clusters? of 19,992 faces$`),
      );
    }
    await page.locator("#knot canvas").focus();
    await page.keyboard.press("ArrowLeft");
    await until("it rests where someone moved it", async () => {
      const stopped = await frames();
      await page.waitForTimeout(1000);
      return (await frames()) === stopped;
    });
    await accessible(page, "the first visit");
    await page.setViewportSize({ width: 1200, height: 630 });
    await page.waitForTimeout(1000);
    await picture(page, "share.jpg");
    await page.close();
    const still = await browser.open(service.url, { reducedMotion: "reduce", knot: true });
    await still.waitForSelector("#knot canvas[data-settled=true]");
    const framesThere = () => still.getAttribute("#knot canvas", "data-frames");
    const at = await framesThere();
    await still.waitForTimeout(1000);
    assert.equal(await framesThere(), at, "nothing moves for those who want no motion");
    await still.close();
  },

  async "neighbours never have one hue, and a cluster keeps its hue while the slider moves"({ service, browser }) {
    const page = await browser.open(service.url);
    const found = await page.evaluate(async () => {
      const { Colouring } = await import("/scene.js");
      // a grid of squares of two triangles, cut into blocks, then each block into four
      const side = 48;
      const [corners, coarse, fine] = [[], [], []];
      for (let cell = 0; cell < side * side; cell++) {
        const [x, y] = [cell % side, Math.floor(cell / side)];
        const at = y * (side + 1) + x;
        corners.push(at, at + 1, at + side + 2, at, at + side + 2, at + side + 1);
        const block = (size) => Math.floor(y / size) * (side / size) + Math.floor(x / size);
        coarse.push(block(8), block(8));
        fine.push(block(4), block(4));
      }
      const number = (labels) => {
        const seen = new Map();
        return Uint32Array.from(labels, (label) => {
          if (!seen.has(label)) seen.set(label, seen.size);
          return seen.get(label);
        });
      };
      /** Edges between clusters of one hue. */
      const alike = (labels, hues) => {
        let count = 0;
        const clusters = new Map();
        for (let i = 0; i < corners.length; i++) {
          const to = i % 3 === 2 ? i - 2 : i + 1;
          const edge = [corners[i], corners[to]].sort((a, b) => a - b).join();
          const [one, other] = [labels[Math.floor(i / 3)], clusters.get(edge)];
          clusters.set(edge, one);
          if (other !== undefined && one !== other && hues[one] === hues[other]) count++;
        }
        return count;
      };
      const colouring = new Colouring(Uint32Array.from(corners));
      const [first, second] = [number(coarse), number(fine)];
      const before = colouring.hues(first, 36).slice();
      const after = colouring.hues(second, 144);
      // the quarter that has the first face of a block
      const keeps = before.filter((hue, block) => after[second[first.indexOf(block)]] === hue).length;
      const plain = Uint8Array.from(after, (_, cluster) => cluster % 2);
      // each triangle is a cluster, and six meet at a vertex
      const third = Uint32Array.from(fine, (_, triangle) => triangle);
      const single = colouring.hues(third, third.length);
      // another job with the same clusters, in another order
      const other = second.map((label) => 143 - label);
      const beside = new Colouring(Uint32Array.from(corners)).hues(other, 144, { labels: second, hues: after });
      // a cone of which each triangle is a cluster: if each met all at its tip, these were a thousand million pairs
      const tips = Uint32Array.from({ length: 50_000 }, (_, at) => at);
      const around = Uint32Array.from({ length: 150_000 }, (_, at) =>
        at % 3 === 0 ? 0 : 1 + ((Math.floor(at / 3) + (at % 3) - 1) % 50_000),
      );
      const fan = new Colouring(around).hues(tips, 50_000);
      return {
        fan: fan.filter((hue, at) => hue === fan[(at + 1) % 50_000]).length,
        alike: alike(first, before) + alike(second, after) + alike(third, single),
        keeps,
        control: alike(second, plain),
        beside: second.filter((label, face) => after[label] !== beside[other[face]]).length,
      };
    });
    assert.ok(found.control > 0, "neighbours of one hue are noticed");
    assert.deepEqual([found.alike, found.keeps, found.beside, found.fan], [0, 36, 0, 0]);
    await page.close();
  },

  async "which way is up is guessed, can be switched, and is in the address"({ service, browser }) {
    const path = meshes && join(meshes, "nefertiti.obj");
    if (!path || !existsSync(path)) return console.log("  left out: there is no folder of meshes");
    const page = await browser.open(service.url);
    await submit(page, path, { name: "nefertiti.obj", clusters: 50, quality: "fast" });
    await succeeded(page);
    await drawn(page, 50);
    const up = () => page.getAttribute("#view canvas", "data-up");
    assert.equal(await up(), "z", "it has a flat base across z");
    const before = (await look(page, "#view")).digest;
    await page.click("#up-axis");
    await until("it is turned", async () => (await look(page, "#view")).digest !== before);
    assert.equal(address(page).get("up"), "y");
    await page.reload();
    await drawn(page, 50);
    assert.deepEqual([await up(), await text(page, "#up-axis")], ["y", "Y up"]);
    await page.close();
  },

  async "colours stand for size, roundness and energy too"({ service, browser }) {
    const page = await browser.open(service.url);
    await submit(page, sample(service, "terrain", 6000), { name: "hills.obj", clusters: 60 });
    await succeeded(page);
    await drawn(page, 60);
    const { clusters: rows } = await (await fetch(`${service.url}/v1/jobs/${idOf(page)}/clusters?format=json`)).json();
    const seen = [(await look(page, "#view")).digest];
    for (const name of ["area", "roundness", "energy"]) {
      await page.selectOption("#colours", name);
      await until(`colours are of ${name}`, async () => !seen.includes((await look(page, "#view")).digest));
      seen.push((await look(page, "#view")).digest);
      assert.equal(address(page).get("colours"), name);
      const numbers = rows.map((row) => row[name]).sort((a, b) => a - b);
      const told = (await page.locator(".ranks > :not(.scale)").allTextContents()).map((end) => /[\d.].*/.exec(end)[0]);
      for (const [i, rank] of [0, 30, 59].entries())
        assert.ok(Math.abs(Number(told[i]) / numbers[rank] - 1) < 0.01, `the legend of ${name} says ${told}`);
    }
    await accessible(page, "a scale");
    await page.selectOption("#colours", "");
    await until("colours are of clusters again", async () => (await look(page, "#view")).digest === seen[0]);
    await page.close();
  },

  async "clusters of a part are planes, spheres and cylinders, with a colour a type"({ service, browser }) {
    const page = await browser.open(service.url);
    await submit(page, sample(service, "part", 3000), { name: "part.obj", clusters: 13, algorithm: "shapes" });
    await succeeded(page);
    await drawn(page, 13);
    const { shapes } = await (await fetch(`${service.url}/v1/jobs/${idOf(page)}/report`)).json();
    const sphere = shapes.find(({ type }) => type === "sphere");
    const before = (await look(page, "#view")).digest;
    await page.selectOption("#colours", "shape");
    await until("colours are of types", async () => (await look(page, "#view")).digest !== before);
    assert.equal(await text(page, "#legend"), "7 planes1 sphere5 cylinders");
    await page.waitForSelector("#curve[data-points]");
    await accessible(page, "shapes");
    await picture(page, "page-shapes.png");
    await page.goto(`${page.url()}&cluster=${sphere.label}`);
    await page.reload();
    await drawn(page, 13);
    await until("the sphere is selected", async () => (await page.locator("#picked [data-fact=shape]").count()) > 0);
    assert.match(await fact(page, "shape"), /^Sphere, radius 1\.1/);
    assert.equal(await fact(page, "side"), "inside");
    await page.close();
  },

  async "the pointer names the cluster under it, Escape lets go, and one cluster can be taken along"({
    service,
    browser,
  }) {
    const page = await browser.open(service.url);
    await page.click("#jobs a:has-text('hills')");
    await drawn(page, 60);
    const shown = await labels(service, idOf(page));
    const position = await middle(page, "#view canvas");
    const { digest } = await look(page, "#view");
    await page.hover("#view canvas", { position });
    await until("a card is at the pointer", () => page.isVisible("#card"));
    const named = await text(page, "#card strong");
    // the pointer rests
    await until("it says what the cluster has", async () => {
      return /^\d+ faces · area [\d.]+ · \d neighbours$/.test(await text(page, "#card > span"));
    });
    await page.mouse.move(0, 0);
    await until("the card is gone", () => page.isHidden("#card"));
    await page.click("#view canvas", { position });
    await until("it is selected", async () => (await page.getAttribute("#picked", "data-cluster")) !== "");
    const selected = Number(await page.getAttribute("#picked", "data-cluster"));
    assert.equal(named, `Cluster ${selected}`);
    const { ink } = await look(page, "#view");
    assert.ok(ink > 25, `the outline is 2 pixels wide: ${ink} pixels`);
    const count = shown.filter((label) => label === selected).length;
    for (const button of ["#card button", "#only"]) {
      const [download] = await Promise.all([page.waitForEvent("download"), page.click(button)]);
      assert.equal(download.suggestedFilename(), `hills-cluster-${selected}.obj`);
      assert.equal(readFileSync(await download.path(), "utf8").match(/^f /gm).length, count);
    }
    await accessible(page, "a card that stays");
    assert.equal(await fact(page, "faces"), String(count));
    await page.keyboard.press("Escape");
    await until("it is let go", async () => (await page.getAttribute("#picked", "data-cluster")) === "");
    await page.mouse.move(0, 0);
    await until("as before", async () => (await look(page, "#view")).digest === digest);
    const [png] = await Promise.all([page.waitForEvent("download"), page.click("#picture")]);
    assert.equal(
      readFileSync(await png.path())
        .subarray(1, 4)
        .toString(),
      "PNG",
    );
    await page.close();
  },

  async "a job is clustered again from the mesh that the service kept, with the same labels"({ service, browser }) {
    const page = await browser.open(service.url);
    await page.click("#jobs a:has-text('hills')");
    await drawn(page, 60);
    const before = idOf(page);
    await page.fill("#again-clusters", "25");
    await page.locator("#again button").click();
    await until("another job is open", () => idOf(page) !== before);
    await succeeded(page);
    await drawn(page, 25);
    const body = readFileSync(sample(service, "terrain", 6000));
    const query = "format=obj&clusters=25&algorithm=bb";
    const answer = await fetch(`${service.url}/v1/jobs?${query}`, {
      method: "POST",
      body,
      headers: { prefer: "wait=60" },
    });
    const { id } = await answer.json();
    await until(
      "it is made",
      async () => (await (await fetch(`${service.url}/v1/jobs/${id}`)).json()).state === "succeeded",
    );
    assert.deepEqual(await labels(service, idOf(page)), await labels(service, id));
    await page.close();
  },

  async "a deletion can be undone for ten seconds"({ service, browser }) {
    const page = await browser.open(service.url, {}, hold);
    await submit(page, sample(service, "sphere", 500), { name: "regret.obj", clusters: 5 });
    await succeeded(page);
    const id = idOf(page);
    const isThere = async () => (await fetch(`${service.url}/v1/jobs/${id}`)).ok;
    await remove(page);
    await until("it is not in the list", async () => !(await text(page, "#jobs")).includes("regret"));
    assert.ok(await isThere());
    await accessible(page, "a deletion");
    await page.click(".undo");
    await drawn(page, 5);
    await until("it is in the list", async () => (await text(page, "#jobs")).includes("regret"));
    await remove(page);
    await pass(page);
    await until("it is deleted", async () => !(await isThere()));
    await page.close();
  },

  async "several meshes become several jobs, and what is no mesh is not sent"({ service, browser }) {
    const page = await browser.open(service.url);
    await page.setInputFiles(
      "#file",
      ["one", "two"].map((name, i) => {
        const path = join(service.folder, `${name}.obj`);
        writeFileSync(path, readFileSync(sample(service, "sphere", 500 + 100 * i)));
        return path;
      }),
    );
    assert.equal(await text(page, "#submit"), "Cluster 2 meshes");
    await page.click("#submit");
    await until("both are jobs", async () => /two.*one|one.*two/.test(await text(page, "#jobs")));
    const note = join(service.folder, "note.txt");
    writeFileSync(note, "no mesh");
    await page.setInputFiles("#file", note);
    assert.match(await text(page, "#notice"), /note\.txt is no mesh/);
    assert.ok(await page.isDisabled("#submit"));
    await page.close();
  },

  async "a failure is said in the page's words, with the button that repairs it"({ service, browser }) {
    const page = await browser.open(service.url);
    await submit(page, sample(service, "parts", 1000), { name: "apart.obj", clusters: 1 });
    await until("it fails", async () => (await page.getAttribute("#state", "data-state")) === "failed");
    const [, parts] = /has (\d+) separate parts/.exec(await text(page, "#state"));
    await accessible(page, "a failure");
    await page.click(`.mend:has-text('Cluster with ${parts}')`);
    await succeeded(page);
    await drawn(page, Number(parts));
    await page.goBack();
    await page.click(".mend:has-text('Join parts')");
    await succeeded(page);
    await drawn(page, 1);
    const duck = ["Duck.gltf", "Duck0.bin"].map((name) => join(meshes ?? "", "gltf/Duck", name));
    if (!meshes || !duck.every(existsSync)) return await page.close();
    await page.setInputFiles("#file", duck[0]);
    await page.selectOption("#algorithm", "bb");
    await page.fill("#clusters", "30");
    await page.click("#submit");
    await page.waitForSelector("label.mend:has-text('Add Duck0.bin')");
    await page.setInputFiles("label.mend input", duck[1]);
    await succeeded(page);
    await drawn(page, 30);
    await page.close();
  },

  async "every mesh that was clustered has a picture in the list, also those that were not opened"({
    service,
    browser,
  }) {
    const made = ["clusters=40", "algorithm=pml"].map(async (query) => {
      const body = readFileSync(sample(service, "terrain", 6000));
      const headers = { prefer: "wait=60" };
      const path = `/v1/jobs?format=obj&keep_mesh=true&${query}`;
      return (await (await fetch(service.url + path, { method: "POST", headers, body })).json()).id;
    });
    const ids = await Promise.all(made);
    const page = await browser.open(service.url);
    for (const id of ids) {
      const shown = `#jobs a[href="#/jobs/${id}"] img`;
      await until("it has a picture", async () => (await page.locator(shown).count()) > 0);
      // the list may be written anew meanwhile
      const hues = () =>
        look(page, shown).then(
          (seen) => seen.hues,
          () => 0,
        );
      await until("it has the hues of clusters", async () => (await hues()) > 4);
    }
    // pictures of other jobs may follow
    await until("nothing of them is left", async () => (await page.locator(".unseen").count()) === 0);
    await page.close();
  },
};
