// For whom the page works: keyboards alone, narrow screens, readers that want no motion; and meshes that are large.
import assert from "node:assert/strict";
import { until } from "./service.mjs";
import { accessible, alone, drawn, idOf, picture, sample, submit, succeeded, text } from "./steps.mjs";

/** Presses Tab until an element has the focus. */
async function tabTo(page, selector, key = "Tab") {
  for (let presses = 0; presses < 150; presses++) {
    await page.keyboard.press(key);
    const { found, outlined } = await page.evaluate((selector) => {
      const { activeElement: element } = document;
      const isOutlined = (element) => getComputedStyle(element).outlineStyle !== "none";
      const outlined = isOutlined(element) || isOutlined(element.parentElement) || element.matches("[role=treeitem]");
      return { found: element.matches(selector), outlined };
    }, selector);
    if (!found) continue;
    assert.ok(outlined, `it is seen that ${selector} has the focus`);
    return;
  }
  throw new Error(`the key ${key} does not lead to ${selector}`);
}

export const reach = {
  async "the keyboard alone does everything"({ service, browser }) {
    const page = await browser.open(service.url, { knot: true });
    const { keyboard } = page;
    await tabTo(page, "#algorithm");
    await keyboard.type("A given");
    await tabTo(page, "#clusters");
    await tabTo(page, "#algorithm", "Shift+Tab");
    await keyboard.type("Any");
    await tabTo(page, "[data-sample=parts]", "Shift+Tab");
    await keyboard.press("Enter");
    await until("the job is open", async () => (await page.locator("#state").count()) > 0);
    await succeeded(page);
    await drawn(page, 100);
    const shown = () => new URLSearchParams(page.url().split("?")[1]);
    await tabTo(page, "#view canvas");
    const frames = () => page.getAttribute("#view canvas", "data-frames").then(Number);
    for (const key of ["ArrowLeft", "ArrowUp", "+", "0"]) {
      const before = await frames();
      await keyboard.press(key);
      await until(`${key} moves the mesh`, async () => (await frames()) > before);
    }
    await tabTo(page, "#up-axis");
    await keyboard.press("Enter");
    await until("another axis is up", () => shown().get("up") !== null);
    await tabTo(page, "#level");
    await keyboard.press("ArrowRight");
    await until("the slider cuts", () => Number(shown().get("clusters")) > 100);
    await drawn(page, Number(shown().get("clusters")));
    await tabTo(page, "details:has(#cluster-table) summary");
    await keyboard.press("Enter");
    await tabTo(page, "#cluster-table tbody button");
    await keyboard.press("Enter");
    await until("a cluster is selected", () => shown().get("cluster") === "0");
    await tabTo(page, "#down", "Shift+Tab");
    const before = Number(shown().get("clusters"));
    await keyboard.press("Enter");
    await until("it is split", () => Number(shown().get("clusters")) > before);
    await tabTo(page, "details:has(#dendrogram) summary");
    await keyboard.press("Enter");
    await page.waitForSelector("#dendrogram [role=treeitem]");
    await tabTo(page, "#dendrogram [role=treeitem]");
    await keyboard.press("ArrowDown");
    await keyboard.press("Enter");
    await until("a node is a cluster", () => Number(shown().get("clusters")) <= 64);
    await tabTo(page, "details:has(#downloads) summary", "Shift+Tab");
    await keyboard.press("Enter");
    await tabTo(page, "[aria-label='Download labels as npy']");
    const [download] = await Promise.all([page.waitForEvent("download"), keyboard.press("Enter")]);
    assert.match(download.suggestedFilename(), /^parts-labels-\d+\.npy$/);
    await tabTo(page, ".menu summary", "Shift+Tab");
    await keyboard.press("Enter");
    await tabTo(page, "#remove");
    await keyboard.press("Enter");
    await until("the job is deleted", async () => !page.url().includes("/jobs/"));
    await page.close();
  },

  async "narrow screens have no sideways scrolling, and nothing moves for those who want no motion"({
    service,
    browser,
  }) {
    const options = { viewport: { width: 360, height: 740 }, colorScheme: "dark", reducedMotion: "reduce" };
    const page = await browser.open(service.url, options);
    await page.click("#jobs a:has-text('quads')");
    await page.waitForSelector("#view canvas[data-frames]");
    assert.ok(Math.abs((await page.locator("#main").boundingBox()).y) < 2, "the job is in sight, above form and list");
    await page.selectOption("#other", { index: 1 });
    await page.waitForSelector("#view [data-panes='2']");
    for (const details of await page.locator("details").all()) await details.evaluate((box) => (box.open = true));
    await page.locator("[aria-label='Download labels as npy']").waitFor();
    for (const width of [320, 360, 400]) {
      await page.setViewportSize({ width, height: 740 });
      const fits = () => page.evaluate(() => document.documentElement.scrollWidth <= innerWidth);
      await until(`it fits into ${width} pixels`, fits, 5000);
    }
    const duration = () =>
      page.locator("#picture").evaluate((button) => {
        button.style.transition = "opacity 1s";
        return getComputedStyle(button).transitionDuration;
      });
    assert.equal(await duration(), "0s");
    await page.emulateMedia({ reducedMotion: "no-preference" });
    assert.equal(await duration(), "1s", "what would move is noticed");
    await page.emulateMedia({ reducedMotion: "reduce" });
    await accessible(page, "a phone");
    await page.close();
  },

  async "a mesh above 5,000,000 triangles is drawn when that is wanted"({ service, browser }) {
    const page = await browser.open(service.url);
    let meshes = 0;
    await page.route(/\/report$/, async (route) => {
      const report = await (await route.fetch()).json();
      report.input.triangles = 5_000_001;
      await route.fulfill({ json: report });
    });
    // those of other jobs are for their pictures in the list
    const isItsMesh = (url) => /\/mesh\?/.test(url) && page.url().includes("jobs/") && url.includes(idOf(page));
    page.on("request", (request) => (meshes += Number(isItsMesh(request.url()))));
    await submit(page, sample(service, "sphere", 500), { name: "gate.obj", clusters: 5 });
    await succeeded(page);
    const button = page.locator("#view button");
    await until("the page asks", async () => (await button.count()) > 0);
    assert.equal(await button.textContent(), "Show 5,000,001 triangles in 3D");
    await page.locator("details:has(#cluster-table) summary").click();
    assert.equal(await page.locator("#cluster-table tbody tr").count(), 5, "the table needs no picture");
    await accessible(page, "a mesh that is not drawn");
    assert.equal(meshes, 0);
    await button.press("Enter");
    await drawn(page, 5);
    assert.equal(meshes, 1);
    await page.close();
  },

  async "a mesh of 1,000,000 triangles turns at once, and a click finds its triangle"({ service, browser }) {
    const page = await browser.open(service.url);
    const found = await page.evaluate(async () => {
      const side = Math.sqrt(500_000);
      const cells = Math.round(side);
      const positions = new Float32Array(18 * cells * cells);
      for (let cell = 0; cell < cells * cells; cell++) {
        const [x, y] = [(cell % cells) / cells, Math.floor(cell / cells) / cells];
        const [right, top] = [x + 1 / cells, y + 1 / cells];
        positions.set([x, y, 0, right, y, 0, right, top, 0, x, y, 0, right, top, 0, x, top, 0], 18 * cell);
      }
      const { View } = await import("/scene.js");
      const box = Object.assign(document.createElement("section"), { className: "view", id: "large" });
      // over the page, which goes on
      box.style.cssText = "position: fixed; inset: 0; height: 500px; z-index: 9";
      document.body.append(box);
      const view = new View(box, { positions, centre: undefined, faces: null, corners: null });
      const { canvas } = view;
      const drawn = async (isThere) => {
        while (!isThere()) await new Promise((resolve) => setTimeout(resolve, 20));
        return Number(canvas.dataset.drawn);
      };
      view.show({ labels: new Uint32Array(view.triangles), colours: new Uint8Array(4) });
      const whole = await drawn(() => view.frames > 0);
      await new Promise((resolve) => setTimeout(resolve, 300));
      const atRest = view.frames;
      const turn = () => canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" }));
      turn();
      // the first frame of a move is measured; those after it are coarse
      const before = view.frames;
      await drawn(() => view.frames > before);
      // on a busy machine the view may be at rest again before it has drawn a frame of a move
      const coarse = await drawn(() => {
        turn();
        return Number(canvas.dataset.drawn) < whole;
      });
      const rested = await drawn(() => Number(canvas.dataset.drawn) === whole);
      view.onPick = ({ triangle }) => (window.picked = Math.floor(triangle / 2));
      return { whole, atRest, coarse, rested, cells };
    });
    const { width, height } = await page.locator("#large canvas").boundingBox();
    await page.locator("#large canvas").click({ position: { x: width / 2, y: height / 2 } });
    const cell = await until("a triangle is found", () => page.evaluate(() => window.picked));
    const place = [cell % found.cells, Math.floor(cell / found.cells)].map((i) => i / found.cells);
    assert.equal(found.atRest, 1, "it is drawn once, until it turns");
    assert.ok(found.whole > 999_000 && found.rested === found.whole);
    assert.ok(found.coarse < found.whole / 10, `${found.coarse} triangles are drawn while it moves`);
    for (const along of place) assert.ok(Math.abs(along - 0.5) < 0.01, `the middle is found at ${place}`);
    await page.close();
  },
};
