// States in which something is missing: a token, the service, room, a job; and what must not be read as HTML.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync, statfsSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { Service, until } from "./service.mjs";
import {
  accessible,
  binary,
  drawn,
  idOf,
  recordStates,
  remove,
  run,
  sample,
  statesOf,
  submit,
  succeeded,
  text,
} from "./steps.mjs";

export const states = {
  async "names are text"({ service, browser }) {
    const page = await browser.open(service.url);
    const name = `<img src=x onerror=window.hit=1>'"&quot;.obj`;
    await submit(page, sample(service, "sphere", 500), { name, clusters: 5 });
    await succeeded(page);
    await drawn(page, 5);
    assert.equal(await text(page, "#job-title"), name);
    assert.equal(await page.locator("img[src=x]").count(), 0);
    assert.equal(await page.evaluate(() => window.hit), undefined);
    await remove(page);
    await until("the job is gone", async () => !(await text(page, "#jobs")).includes("onerror"));
    await page.close();
  },

  async "what cannot be done is said"({ service, browser }) {
    const page = await browser.open(service.url);
    const body = readFileSync(sample(service, "sphere", 500));
    const query = "format=obj&clusters=100000";
    const { id } = await (await fetch(`${service.url}/v1/jobs?${query}`, { method: "POST", body })).json();
    await page.goto(`${service.url}/#/jobs/${id}`);
    await until("the job fails", async () => (await text(page, "#state")).startsWith("Failed: "));
    const [, faces] = /The mesh has (\d+) faces/.exec(await text(page, "#state"));
    assert.equal(await text(page, ".mend"), `Choose the mesh, cluster with ${faces}`);
    await page.goto(`${service.url}/#/jobs/00000000-0000-4000-8000-000000000000`);
    await until("the job is not there", async () => /no such job|no job/i.test(await text(page, "#notice")));
    await page.close();
  },

  async "a mesh that the service refuses is refused in its words"({ browser }) {
    // a reserve that the disk has, but not now
    const { blocks, bavail, bsize } = statfsSync(tmpdir());
    const reserve = Math.floor((bsize * (blocks + bavail)) / 2);
    const service = await new Service(binary).start("--min-free-bytes", String(reserve));
    try {
      const page = await browser.open(service.url);
      await page.setInputFiles("#file", sample(service, "knot", 200_000));
      await page.click("#submit");
      await until("the setting is named", async () => /--min-free-bytes/.test(await text(page, "#notice")));
      assert.ok(await page.isHidden("#sending"));
      assert.ok(await page.isEnabled("#submit"), "another mesh can be sent");
      await accessible(page, "a refusal");
      await page.close();
    } finally {
      await service.stop();
    }
  },

  async "what is above a limit of the service is not sent"({ browser }) {
    const service = await new Service(binary).start("--max-upload-bytes", "100000", "--max-faces", "1000");
    try {
      const page = await browser.open(service.url);
      let posts = 0;
      page.on("request", (request) => (posts += request.method() === "POST"));
      const choose = (file) => page.setInputFiles("#file", file);
      await choose(sample(service, "knot", 200_000));
      await until("the bytes are named", async () =>
        /^knot\.obj has [\d.]+ MB\. This service takes 100 kB at most\.$/.test(await text(page, "#notice")),
      );
      assert.ok(await page.isDisabled("#submit"));
      for (const [name, head] of [
        ["many.ply", "ply\nformat ascii 1.0\nelement vertex 3\nelement face 1001\n"],
        ["many.off", "OFF # of hills\n3 1001 0\n"],
        ["many.stl", Buffer.concat([Buffer.alloc(80), Buffer.from([0xe9, 3, 0, 0]), Buffer.alloc(50 * 1001)])],
      ]) {
        await choose({ name, mimeType: "model/mesh", buffer: Buffer.from(head) });
        await until("the faces are named", async () =>
          (await text(page, "#notice")).startsWith(`${name} has 1,001 faces. This service clusters 1,000 at most.`),
        );
        assert.ok(await page.isDisabled("#submit"));
      }
      await accessible(page, "a limit");
      await choose(sample(service, "sphere", 500));
      await page.selectOption("#algorithm", "bb");
      await page.fill("#clusters", "5");
      assert.equal(posts, 0);
      await page.click("#submit");
      await succeeded(page);
      assert.equal(posts, 1);
      await page.close();
    } finally {
      await service.stop();
    }
  },

  async "what is too much for now is sent again when the service says"({ browser }) {
    const service = await new Service(binary).start("--meshes-in-memory", "1", "--max-queued-jobs", "1");
    try {
      const body = readFileSync(sample(service, "knot", 300_000));
      // the first one runs until it is deleted
      const query = "format=obj&algorithm=ml";
      const post = () => fetch(`${service.url}/v1/jobs?${query}`, { method: "POST", body });
      const inTheWay = [];
      await until("there is no room", async () => {
        const answer = await post();
        return answer.status === 429 || (inTheWay.push(await answer.json()), false);
      });
      const page = await browser.open(service.url);
      await page.setInputFiles("#file", sample(service, "sphere", 500));
      await page.selectOption("#algorithm", "bb");
      await page.fill("#clusters", "5");
      await page.click("#submit");
      await until("the page says when", async () => /The page tries again in \d+ s/.test(await text(page, "#notice")));
      await accessible(page, "429");
      for (const { id } of inTheWay) await fetch(`${service.url}/v1/jobs/${id}`, { method: "DELETE" });
      await succeeded(page);
      await drawn(page, 5);
      assert.ok(await page.isHidden("#notice"));
      // a list that was asked for too often
      let refused = 0;
      const listed = Date.now();
      await page.route(`${service.url}/v1/jobs?*`, async (route) => {
        if (refused++ > 0) return await route.fallback();
        const json = { title: "Too many requests", detail: "too many requests" };
        await route.fulfill({ status: 429, headers: { "retry-after": "3" }, json });
      });
      await until("the page says when", async () => /tries again in 3 s/.test(await text(page, "#notice")));
      await until("the list is there again", () => refused > 1 && page.isHidden("#notice"));
      assert.ok(Date.now() - listed >= 3000);
      await page.close();
    } finally {
      await service.stop();
    }
  },

  async "a service that is killed and comes back loses nothing, and the page needs no reload"({ browser }) {
    const service = await new Service(binary).start("--meshes-in-memory", "1");
    try {
      const open = async () => {
        const page = await browser.open(service.url, { reducedMotion: "reduce" });
        await page.evaluate(() => (window.marker = 1));
        return page;
      };
      const [result, running, waiting] = [await open(), await open(), await open()];
      await submit(result, sample(service, "sphere", 2000), { name: "tree.obj", algorithm: "pml" });
      await succeeded(result);
      await drawn(result, 100);
      const slow = { name: "slow.obj", clusters: 3000, quality: "best" };
      await submit(running, sample(service, "knot", 220_000), slow);
      await until("it runs", async () => (await text(running, "#state")).startsWith("Running"));
      await running.waitForSelector("#preview canvas[data-frames]");
      await submit(waiting, sample(service, "sphere", 500), { name: "next.obj", clusters: 5 });
      await until("it waits", async () => (await text(waiting, "#state")) === "Waiting, number 1 in the queue");
      await service.kill();
      for (const page of [result, running, waiting])
        await until("the page says so", async () => /does not answer/.test(await text(page, "#notice")));
      await service.again();
      await succeeded(running);
      await drawn(running, 3000);
      await succeeded(waiting);
      await drawn(waiting, 5);
      await result.locator("#level").focus();
      await result.keyboard.press("End");
      const cut = await until("the slider cuts", () => Number(/clusters=(\d+)/.exec(result.url())?.[1]));
      await drawn(result, cut);
      for (const page of [result, running, waiting]) {
        await until("nothing is wrong any more", () => page.isHidden("#notice"));
        assert.equal(await page.locator("#jobs li").count(), 3);
        assert.equal(await page.evaluate(() => window.marker), 1);
        await page.close();
      }
    } finally {
      await service.stop();
    }
  },

  async "a job that was given up and is run again is followed without a reload"({ browser }) {
    const service = await new Service(binary).start("--max-attempts", "1", "--meshes-in-memory", "1");
    try {
      const page = await browser.open(service.url);
      const points = async (page) => Number(await page.getAttribute("#curve", "data-points"));
      await submit(page, sample(service, "knot", 150_000), { name: "again.obj", clusters: 1000, quality: "best" });
      await until("energies come", async () => (await points(page)) > 0);
      await service.kill();
      await service.again();
      await until("it is given up", async () => (await text(page, "#state")).startsWith("Failed: "));
      const late = await browser.open(service.url, {}, undefined, `/${new URL(page.url()).hash}`);
      await until("it is given up", async () => (await text(late, "#state")).startsWith("Failed: "));
      for (const one of [page, late]) await recordStates(one);
      // the retried job waits while another one runs, which lasts until it is deleted
      const body = readFileSync(sample(service, "knot", 300_000));
      const query = "format=obj&algorithm=ml";
      const other = await (await fetch(`${service.url}/v1/jobs?${query}`, { method: "POST", body })).json();
      const job = `${service.url}/v1/jobs/${other.id}`;
      await until("it runs", async () => (await (await fetch(job)).json()).state === "running");
      const answer = await fetch(`${service.url}/v1/jobs/${idOf(page)}/retry`, { method: "POST" });
      assert.equal(answer.status, 202);
      for (const one of [page, late])
        await until("it waits", async () => (await text(one, "#state")).startsWith("Waiting"));
      await fetch(job, { method: "DELETE" });
      for (const one of [page, late]) {
        await succeeded(one);
        await drawn(one, 1000);
        assert.ok((await statesOf(one)).some((state) => state.startsWith("Running")));
      }
      const reloaded = await browser.open(service.url, {}, undefined, `/${new URL(page.url()).hash}`);
      await drawn(reloaded, 1000);
      const { iterations } = await (await fetch(`${service.url}/v1/jobs/${idOf(page)}/report`)).json();
      for (const one of [page, late, reloaded]) {
        await until("the curve is of one attempt", async () => (await points(one)) === iterations.length);
        await one.close();
      }
    } finally {
      await service.stop();
    }
  },

  async "a service that is killed while results are fetched shows them when it is back"({ service, browser }) {
    let killed = null;
    const page = await browser.open(service.url, {}, (page) =>
      page.route(`${service.url}/v1/jobs/*/labels*`, async (route) => {
        // pictures of other jobs in the list need labels, too
        const isOpen = page.url().includes("jobs/") && route.request().url().includes(idOf(page));
        if (isOpen) await (killed ??= service.kill());
        await route.continue().catch(() => {});
      }),
    );
    await submit(page, sample(service, "sphere", 500), { name: "fetched.obj", clusters: 5 });
    await until("the page says so", async () => /does not answer/.test(await text(page, "#notice")));
    await service.again();
    await drawn(page, 5);
    await until("nothing is wrong any more", () => page.isHidden("#notice"));
    await page.close();
  },

  async "a service that is gone is said on every page, and its return is noticed"({ service, browser }) {
    const page = await browser.open(service.url);
    await submit(page, sample(service, "sphere", 500), { name: "gone.obj", clusters: 5 });
    await succeeded(page);
    await page.goto(`${service.url}/#/`);
    await service.kill();
    await until("the page says so", async () => /does not answer/.test(await text(page, "#notice")));
    await page.click("#jobs a:has-text('gone')");
    await service.again();
    await drawn(page, 5);
    await until("nothing is wrong any more", async () => !(await page.isVisible("#notice")));
    await page.close();
  },

  async "a script that could not be loaded is loaded at the next use"({ service, browser }) {
    let refused = 0;
    const page = await browser.open(service.url, { knot: true }, (page) =>
      page.route(`${service.url}/scene.js`, (route) => (++refused, route.abort())),
    );
    await until("it could not be loaded", () => refused > 0);
    await page.click("[data-sample=terrain]");
    await page.waitForSelector("#state");
    await page.close();
  },

  async "a token is kept for the session and sent in a header"({ browser }) {
    const service = new Service(binary);
    try {
      const file = join(service.folder, "tokens.json");
      const token = execFileSync(binary, ["token", "new", "mine", "--tokens", file], { timeout: 60_000 })
        .toString()
        .trim();
      await service.start("--tokens", file);
      const page = await browser.open(service.url);
      await until("a token is needed", async () => (await text(page, "#notice")) === "This service wants a token.");
      await page.fill("#token", "tess_unknown");
      await page.keyboard.press("Enter");
      await until("it is not known", async () => /does not know this token/.test(await text(page, "#notice")));
      await page.fill("#token", token);
      await page.keyboard.press("Enter");
      await until("the jobs are listed", async () => (await text(page, "#jobs")) === "Your jobs appear here.");
      await page.click("[data-sample=parts]");
      await page.waitForSelector("#state");
      await succeeded(page);
      await page.reload();
      await succeeded(page);
      await drawn(page, 100);
      assert.ok(!page.url().includes(token));
      await page.evaluate(() => Object.defineProperty(navigator, "clipboard", { value: undefined }));
      await page.click("#copy-curl");
      const command = await page.inputValue("#take textarea");
      assert.ok(!command.includes(token), "a token is not copied");
      execFileSync(binary, ["sample", "parts", "--faces", "500", join(service.folder, "parts.obj")]);
      await run(command, service, { TOKEN: token });
      const kept = await page.evaluate(() => {
        const names = Object.keys(sessionStorage).filter((name) => !name.startsWith("picture-"));
        return [localStorage.length, document.cookie, names];
      });
      assert.deepEqual(kept, [0, "", ["tesserae-token"]]);
      await page.close();
    } finally {
      await service.stop();
    }
  },
};
