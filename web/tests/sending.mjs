// Sending a mesh, and what is seen of it before it is clustered.
import assert from "node:assert/strict";
import { existsSync, readFileSync, writeFileSync } from "node:fs";
import { basename, join } from "node:path";
import { isDeepStrictEqual } from "node:util";
import { look } from "./browser.mjs";
import { Service, until } from "./service.mjs";
import { accessible, binary, drawn, labels, meshes, sample, succeeded, text } from "./steps.mjs";

const jobs = async (service) => (await (await fetch(`${service.url}/v1/jobs`)).json()).jobs;

/** A glTF file of one triangle that would like the page to look elsewhere. */
function curious(service) {
  const positions = Buffer.from(new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0]).buffer);
  const document = {
    asset: { version: "2.0" },
    scenes: [{ nodes: [0] }],
    nodes: [{ mesh: 0 }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0 }, material: 0 }] }],
    materials: [{ pbrMetallicRoughness: { baseColorTexture: { index: 0 } } }],
    textures: [{ source: 0 }],
    images: [{ uri: "http://127.0.0.2:9/tracker.png" }],
    accessors: [{ bufferView: 0, componentType: 5126, count: 3, type: "VEC3", min: [0, 0, 0], max: [1, 1, 0] }],
    bufferViews: [{ buffer: 0, byteLength: 36 }],
    buffers: [{ byteLength: 36, uri: `data:application/octet-stream;base64,${positions.toString("base64")}` }],
  };
  const path = join(service.folder, "curious.gltf");
  writeFileSync(path, JSON.stringify(document));
  return path;
}

/** Whether the middle of the preview is not its background. */
async function drawsSomething(page) {
  const background = await page.locator("#preview").evaluate((box) => getComputedStyle(box).backgroundColor);
  return !isDeepStrictEqual((await look(page, "#preview")).centre, background.match(/\d+/g).map(Number));
}

export const sending = {
  async "it says how much of a mesh is sent, and can be stopped"({ service, browser }) {
    const page = await browser.open(service.url);
    const before = (await jobs(service)).length;
    const session = await page.context().newCDPSession(page);
    const pace = (bytes) =>
      session.send("Network.emulateNetworkConditions", {
        offline: false,
        latency: 0,
        downloadThroughput: -1,
        uploadThroughput: bytes,
      });
    await session.send("Network.enable");
    await pace(200_000);
    await page.setInputFiles("#file", sample(service, "knot", 60_000));
    await page.click("#submit");
    await until("a part is sent", async () =>
      /^[\d.]+ .B of [\d.]+ MB, \d+ s left$/.test(await text(page, "#sent-text")),
    );
    const { value, max } = await page.locator("#sent").evaluate(({ value, max }) => ({ value, max }));
    assert.ok(value > 0 && value < max);
    await page.click("#stop");
    await until("it ends", () => page.isHidden("#sending"));
    assert.equal((await jobs(service)).length, before);
    assert.ok(await page.isHidden("#notice"), "to stop is no error");
    await page.close();
  },

  async "a mesh whose sending breaks is sent again, and becomes one job"({ service, browser }) {
    const page = await browser.open(service.url);
    await page.setInputFiles("#file", sample(service, "sphere", 700));
    await page.selectOption("#algorithm", "bb");
    await page.fill("#clusters", "7");
    await service.kill();
    await page.click("#submit");
    await until("the page says so", async () => /is sent again/.test(await text(page, "#notice")));
    await service.again();
    await page.waitForSelector("#state");
    await succeeded(page);
    const same = (await jobs(service)).filter(({ mesh, parameters }) => {
      return mesh.file_name === "sphere.obj" && parameters.clusters === 7;
    });
    assert.equal(same.length, 1);
    await page.close();
  },

  async "a mesh of every format is seen while it waits, and asks no other host for anything"({ browser }) {
    const service = await new Service(binary).start("--meshes-in-memory", "1");
    try {
      // half a minute each, one after the other, until they are deleted
      const body = readFileSync(sample(service, "knot", 300_000));
      const before = [];
      for (let number = 0; number < 8; number++) {
        const answer = await fetch(`${service.url}/v1/jobs?format=obj&algorithm=ml`, { method: "POST", body });
        before.push(await answer.json());
      }
      const off = join(service.folder, "square.off");
      writeFileSync(off, "OFF\n# a square\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n");
      const files = [
        [sample(service, "knot", 3000)],
        [sample(service, "quads", 3000, "glb")],
        [curious(service)],
        [off],
      ];
      for (const names of [["gltf/Duck/Duck.gltf", "gltf/Duck/Duck0.bin"], ["featuretype.stl"], ["horse.ply"]]) {
        const paths = meshes ? names.map((name) => join(meshes, name)) : [];
        if (paths.length > 0 && paths.every(existsSync)) files.push(paths);
      }
      const page = await browser.open(service.url);
      for (const paths of files) {
        await page.goto(`${service.url}/#/`);
        await page.setInputFiles("#file", paths);
        await page.click("#submit");
        await page.waitForSelector("#preview canvas[data-frames]");
        await until(`${paths[0]} waits`, async () =>
          /^Waiting, number \d+ in the queue$/.test(await text(page, "#state")),
        );
        assert.ok(await drawsSomething(page), `${paths[0]} is in the middle`);
      }
      const compressed = meshes && join(meshes, "gltf/Duck-meshopt.glb");
      if (compressed && existsSync(compressed)) {
        await page.goto(`${service.url}/#/`);
        await page.setInputFiles("#file", compressed);
        await page.click("#submit");
        await until("the page says why there is no picture", async () =>
          /cannot draw this file by itself: it is compressed/.test(await text(page, "#job")),
        );
      }
      for (const { id } of before.reverse()) await fetch(`${service.url}/v1/jobs/${id}`, { method: "DELETE" });
      await page.close();
    } finally {
      await service.stop();
    }
  },

  async "clusters of a running job are seen as they change, those of a waiting one are not"({ browser }) {
    const service = await new Service(binary).start("--meshes-in-memory", "1");
    try {
      const body = readFileSync(sample(service, "knot", 200_000, "glb"));
      const send = async () => {
        const url = `${service.url}/v1/jobs?format=glb&algorithm=ml`;
        return (await (await fetch(url, { method: "POST", body })).json()).id;
      };
      const [running, waiting] = [await send(), await send()];
      const page = await browser.open(service.url);
      const open = async (id) => {
        await page.goto(`${service.url}/#/jobs/${id}`);
        await page.waitForSelector("#preview canvas[data-frames]");
      };
      await open(waiting);
      await until("it waits", async () => /^Waiting/.test(await text(page, "#state")));
      assert.equal((await look(page, "#preview")).hues, 0, "it is grey");
      await open(running);
      const shown = () => page.getAttribute("#preview", "data-shown").then(Number);
      await until("there are clusters", async () => (await shown()) > 0);
      const first = await look(page, "#preview");
      assert.ok(first.hues > 5, "in their hues");
      const before = await shown();
      await until("they change", async () => (await shown()) > before + 1);
      assert.notEqual((await look(page, "#preview")).digest, first.digest);
      for (const id of [waiting, running]) await fetch(`${service.url}/v1/jobs/${id}`, { method: "DELETE" });
      await page.close();
    } finally {
      await service.stop();
    }
  },

  async "clusters keep the hues of the run when it ends, and a phase has a word"({ service, browser }) {
    const query = "format=glb&keep_mesh=true&algorithm=bb&clusters=60";
    const body = readFileSync(sample(service, "knot", 3000, "glb"));
    const sent = await fetch(`${service.url}/v1/jobs?${query}`, {
      method: "POST",
      body,
      headers: { prefer: "wait=60" },
    });
    const { id } = await sent.json();
    await until("it is made", async () => (await (await fetch(`${service.url}/v1/jobs/${id}`)).json()).result);
    // the run shows the clusters of the result under other numbers, until it is to end
    const numbers = await labels(service, id);
    const changes = new Uint32Array(2 * numbers.length);
    for (const [face, label] of numbers.entries()) changes.set([face, (37 * label + 11) % 60], 2 * face);
    const data = { faces: numbers.length, changes: Buffer.from(changes.buffer).toString("base64") };
    const event = (name, data) => `event: ${name}\ndata: ${JSON.stringify(data)}\n\n`;
    const iteration = (number) => event("iteration", { iteration: number, phase: "boundary", energy: 9 - number });
    const contentType = "text/event-stream";
    let [isOver, streams, end] = [false, 0, null];
    const ended = new Promise((resolve) => (end = resolve));
    const page = await browser.open(
      service.url,
      {},
      async (page) => {
        await page.route(`${service.url}/v1/jobs/${id}`, async (route) => {
          const response = await route.fetch();
          const job = await response.json();
          await route.fulfill({ response, json: isOver ? job : { ...job, state: "running", result: null } });
        });
        await page.route(`${service.url}/v1/jobs/${id}/upload**`, (route) => {
          const part = /bytes=0-0/.test(route.request().headers().range ?? "");
          const headers = { "content-range": `bytes 0-0/${body.length}` };
          return route.fulfill(part ? { status: 206, headers, body: "g" } : { body });
        });
        await page.route(`${service.url}/v1/jobs/${id}/events**`, async (route) => {
          const first = event("state", { state: "running" }) + iteration(0) + iteration(1) + event("labels", data);
          if (streams++ === 0) return await route.fulfill({ contentType, body: first });
          await ended;
          await route
            .fulfill({ contentType, body: event("end", { state: "succeeded", problem: null }) })
            .catch(() => {});
        });
      },
      `/#/jobs/${id}`,
    );
    await until("clusters are seen", async () => Number(await page.getAttribute("#preview", "data-shown")) > 0);
    await until("the phase has a word", async () => /^Running: settling borders/.test(await text(page, "#state")));
    await accessible(page, "a running job");
    const places = async (view) => {
      const seen = [];
      for (let i = 2; i < 8; i++) seen.push((await look(page, view, i / 10, (i + 1) / 10)).centre);
      return seen;
    };
    const before = await places("#preview");
    const hued = before.filter((colour) => Math.max(...colour) - Math.min(...colour) > 40);
    assert.ok(hued.length >= 3, "places show clusters");
    isOver = true;
    end();
    await drawn(page, 60);
    for (const [i, colour] of (await places("#view")).entries())
      assert.ok(
        Math.max(...colour.map((channel, c) => Math.abs(channel - before[i][c]))) < 12,
        `${colour}, ${before[i]}`,
      );
    await page.close();
  },

  async "a mesh that another client sent is seen while its job waits and runs"({ browser }) {
    const service = await new Service(binary).start("--meshes-in-memory", "1");
    try {
      const send = async (query, [mesh, ...buffers]) => {
        const form = new FormData();
        const append = (part, path) => form.append(part, new Blob([readFileSync(path)]), basename(path));
        append("mesh", mesh);
        for (const buffer of buffers) append("buffer", buffer);
        const answer = await fetch(`${service.url}/v1/jobs?keep_mesh=true&${query}`, { method: "POST", body: form });
        assert.equal(answer.status, 202);
        return (await answer.json()).id;
      };
      // the first one runs until it is deleted
      const first = await send("algorithm=ml", [sample(service, "knot", 300_000)]);
      const others = [["quads.glb", [sample(service, "quads", 3000, "glb")]]];
      const duck = ["Duck.gltf", "Duck0.bin"].map((name) => join(meshes ?? "", "gltf/Duck", name));
      if (meshes && duck.every(existsSync)) others.push(["Duck.gltf", duck]);
      const opened = [["knot.obj", first, /^Running/]];
      for (const [name, paths] of others) opened.push([name, await send("clusters=5", paths), /^Waiting, number \d/]);
      const page = await browser.open(service.url);
      for (const [name, id, state] of opened) {
        await page.goto(`${service.url}/#/jobs/${id}`);
        await until(`${name} is open`, async () => (await page.locator("#job-title").textContent()) === name);
        await page.waitForSelector("#preview canvas[data-frames]");
        await until(`${name} is in its state`, async () => state.test(await text(page, "#state")));
        assert.ok(await drawsSomething(page), `${name} is in the middle`);
      }
      await fetch(`${service.url}/v1/jobs/${first}`, { method: "DELETE" });
      await succeeded(page);
      await drawn(page, 5);
      await page.close();
    } finally {
      await service.stop();
    }
  },
};
