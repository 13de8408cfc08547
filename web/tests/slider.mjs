// The slider over the mesh of the first visit and over one of 200,000 faces, as a hand drags it.
import assert from "node:assert/strict";
import { until } from "./service.mjs";
import { alone, drawn, sample, submit, succeeded } from "./steps.mjs";
import { slowness } from "./yardstick.mjs";

/** Most milliseconds of processors for a frame: two of them draw 60 a second of the first visit, 30 of 200,000 faces. */
const [FIRST_MS, LARGE_MS] = [33, 66];

/** Runs in a page: moves the slider from one place to another in 100 frames, as a hand does that drags it. */
async function move([from, to]) {
  const [range, view] = [document.querySelector("#level"), document.querySelector(".view:not(.unseen)")];
  const canvas = view.querySelector("canvas");
  const [cuts, began] = [new Set(), performance.now()];
  for (let frame = 0; frame < 100; frame++) {
    range.value = String(from + (frame * (to - from)) / 100);
    range.dispatchEvent(new Event("input"));
    await new Promise(requestAnimationFrame);
    cuts.add(view.dataset.clusters);
  }
  // until what was drawn is there
  canvas.getContext("webgl2").readPixels(0, 0, 1, 1, 6408, 5121, new Uint8Array(4));
  return { cuts: cuts.size, width: canvas.width, rate: (1000 * cuts.size) / (performance.now() - began) };
}

/** Drags the slider between two places, where every frame has another cut in little time. */
async function drag(browser, page, low, high, most) {
  const spent = async (from, to) => {
    const before = await browser.spent(["renderer", "GPU"]);
    const moved = await page.evaluate(move, [from, to]);
    return { ...moved, ms: ((await browser.spent(["renderer", "GPU"])) - before) / 100 };
  };
  await page.waitForTimeout(1500);
  // the first one finds out what a frame takes
  await spent(high, low);
  const drags = [await spent(low, high), await spent(high, low), await spent(low, high), await spent(high, low)];
  const allowed = most * (await slowness(browser));
  const told = drags.map(
    ({ ms, rate }) => `${Math.round(ms)} ms of processors a frame at ${Math.round(rate)} a second`,
  );
  const measured = `${told.join(", ")}; at most ${Math.round(allowed)} ms`;
  console.log(`  ${measured}`);
  for (const { cuts } of drags) assert.ok(cuts > 90, `every frame has another cut: ${cuts} in 100 frames`);
  assert.ok(Math.min(...drags.map(({ ms }) => ms)) <= allowed, measured);
  return drags[0];
}

export const slider = {
  async "every frame of the first visit's slider has another cut, in time"({ browser }) {
    await alone(browser, {}, async (page) => {
      await page.waitForSelector("#knot canvas[data-frames]");
      await drag(browser, page, 400, 1000, FIRST_MS);
    });
  },

  async "every frame of a moving slider has another cut, of 200,000 faces, in time"({ browser }) {
    await alone(browser, {}, async (page, service) => {
      await submit(page, sample(service, "knot", 200_000, "glb"), { name: "fast.glb", algorithm: "pml" });
      await succeeded(page);
      await drawn(page, 100);
      const { width } = await drag(browser, page, 200, 800, LARGE_MS);
      await until("at rest the picture is sharp", async () => {
        const now = await page.evaluate(() => document.querySelector("#view canvas").width);
        return now > width;
      });
    });
  },
};
