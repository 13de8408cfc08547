// Deletions with their undo, what the session keeps, and answers that come late.
import assert from "node:assert/strict";
import { until } from "./service.mjs";
import { accessible, drawn, hold, idOf, pass, remove, sample, submit, succeeded } from "./steps.mjs";

const isThere = async (service, id) => (await fetch(`${service.url}/v1/jobs/${id}`)).ok;

export const deletions = {
  async "each of several deletions can be undone, also after a reload, and covers no slider"({ service, browser }) {
    const page = await browser.open(service.url, { viewport: { width: 1280, height: 720 }, knot: true }, hold);
    const made = [];
    const names = ["stays.obj", "goes.obj"];
    for (const name of names) {
      await submit(page, sample(service, "sphere", 500), { name, algorithm: "pml" });
      await succeeded(page);
      made.push(idOf(page));
    }
    for (const [i, id] of made.entries()) {
      await page.goto(`${service.url}/#/jobs/${id}`);
      await page.waitForSelector(`#job-title:has-text('${names[i]}')`);
      await succeeded(page);
      await remove(page);
    }
    assert.equal(await page.locator(".undo").count(), 2);
    const [toast, slider] = [await page.locator("#toast").boundingBox(), await page.locator(".level").boundingBox()];
    assert.ok(toast.x + toast.width < slider.x);
    await accessible(page, "two deletions");
    await page.reload();
    await page.click("[aria-label='Undo the deletion of stays.obj']");
    await page.waitForSelector("#job-title:has-text('stays')");
    assert.equal(await page.evaluate(() => document.activeElement.id), "main");
    await pass(page);
    await until("the other one is deleted", async () => !(await isThere(service, made[1])));
    assert.ok(await isThere(service, made[0]));
    await until("nothing is left of them", () => page.isHidden("#toast"));
    await page.close();
  },

  async "a deletion is undone after a step back, and not repeated by a tab that is closed, copied or opened again"({
    service,
    browser,
  }) {
    const page = await browser.open(service.url, { knot: true }, hold);
    await submit(page, sample(service, "sphere", 500), { name: "back.obj", clusters: 5 });
    await succeeded(page);
    const id = idOf(page);
    await remove(page);
    await until("the focus is in the page", () => page.evaluate(() => document.activeElement.id === "main"));
    await page.goBack();
    await page.waitForSelector(".nothing h2");
    await page.click(".undo");
    await drawn(page, 5);
    await remove(page);
    const opened = page.waitForEvent("popup");
    await page.evaluate(() => void window.open("/"));
    const copy = await opened;
    await copy.waitForSelector("#jobs a");
    assert.equal(await copy.locator(".undo").count(), 0);
    await copy.close();
    await page.close();
    const later = await browser.open(service.url);
    const deletion = [id, { name: "back.obj", hash: `#/jobs/${id}`, until: Date.now() - 1 }];
    await later.evaluate((deletion) => sessionStorage.setItem("deletions", JSON.stringify([deletion])), deletion);
    await later.reload();
    await later.waitForSelector("#jobs a:has-text('back')");
    assert.equal(await later.evaluate(() => sessionStorage.getItem("deletions")), null);
    assert.ok(await isThere(service, id));
    await later.close();
  },

  async "the page works where the session keeps nothing, or has no room"({ service, browser }) {
    const off = () =>
      Object.defineProperty(window, "sessionStorage", {
        get: () => {
          throw new DOMException("off");
        },
      });
    const full = () =>
      (Storage.prototype.setItem = () => {
        throw new DOMException("full", "QuotaExceededError");
      });
    for (const none of [off, full]) {
      const page = await browser.open(service.url, {}, (page) => page.addInitScript(none));
      await submit(page, sample(service, "sphere", 500), { name: "unkept.obj", clusters: 5 });
      await succeeded(page);
      await page.waitForSelector(`#jobs a[href$="${idOf(page)}"] img`);
      await remove(page);
      await page.click(".undo");
      await drawn(page, 5);
      await page.close();
    }
  },

  async "an answer about a job that is no longer open closes no other one"({ service, browser }) {
    const page = await browser.open(service.url);
    const made = [];
    for (const name of ["late.obj", "open.obj"]) {
      await submit(page, sample(service, "sphere", 500), { name, clusters: 5 });
      await succeeded(page);
      made.push(idOf(page));
    }
    const late = `${service.url}/v1/jobs/${made[0]}`;
    await page.goto(`${service.url}/#/jobs/${made[0]}`);
    await page.waitForSelector("#job-title:has-text('late')");
    await succeeded(page);
    let [release, isAsked] = [null, false];
    const held = new Promise((resolve) => (release = resolve));
    await page.route(late, async (route) => {
      isAsked = true;
      await held;
      await route.fallback();
    });
    await fetch(late, { method: "DELETE" });
    await until("the page asks for the job", () => isAsked);
    await page.goto(`${service.url}/#/jobs/${made[1]}`);
    await page.waitForSelector("#job-title:has-text('open')");
    const answer = page.waitForResponse(late);
    release();
    assert.equal((await answer).status(), 404);
    await page.waitForResponse(/jobs\?limit=50/);
    assert.equal(await page.locator("#job-title:has-text('open')").count(), 1);
    assert.ok(await page.isHidden("#notice"));
    await page.close();
  },
};
