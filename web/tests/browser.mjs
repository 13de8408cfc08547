// Chromium without windows, with an empty profile and software GL, and what a page must not do: foreign requests,
// violations of the policy, errors. Each is recorded, and `complaints` has them all.
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { chromium } from "playwright-core";
import { until, within } from "./service.mjs";

const FLAGS = [
  "--no-sandbox",
  "--disable-quic",
  "--no-first-run",
  "--disable-background-networking",
  "--disable-component-update",
  "--disable-sync",
  `--disable-features=${[
    // Playwright's, whose list this one replaces
    "AvoidCorsURLLoaderRestartOnRedirect",
    "AvoidUnnecessaryBeforeUnloadCheckSync",
    "AimEnabled",
    "DestroyProfileOnBrowserClose",
    "HttpsFirstBalancedModeAutoEnable",
    "HttpsUpgrades",
    "LensOverlay",
    "MediaRouter",
    "NetworkTimeServiceQuerying",
    "OptimizationHints",
    "PaintHolding",
    "PreconnectToSearch",
    "ThirdPartyStoragePartitioning",
    // documents of the address bar, loaded for every window, and processes in advance
    "PreloadTopChromeWebUI",
    "SpareRendererForSitePerProcess",
    "WebUIOmniboxAimPopup",
    "WebUIOmniboxPopup",
  ]}`,
];

/** Chromium's own software GL, which bars of times are of. */
const OWN_GL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"];

/** Mesa's, which takes half of that one's time of processors: it keeps compiled shaders. */
const MESA_GL = ["--use-gl=angle", "--use-angle=gl-egl", "--ignore-gpu-blocklist"];
const MESA = {
  LIBGL_ALWAYS_SOFTWARE: "1",
  __EGL_VENDOR_LIBRARY_FILENAMES: "/usr/share/glvnd/egl_vendor.d/50_mesa.json",
};

/** Most time of a call of Playwright, and until the browser has closed. */
const [CALL_MS, CLOSE_MS] = [180_000, 60_000];

const FILES = ["page.js", "scene.js", "page.css", "mark.svg", "licences.txt"];

export class Browser {
  /**
   * `files`: a folder whose bundle is served in place of that of the binary, while it is worked on. `mesa`: whether Mesa
   * draws.
   */
  constructor(files, { mesa = false } = {}) {
    this.files = files;
    this.complaints = [];
    this.options = {
      executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium-headless-shell",
      args: [...FLAGS, ...(mesa ? MESA_GL : OWN_GL)],
      env: { ...process.env, ...(mesa ? MESA : {}) },
    };
  }

  async launch() {
    this.chromium = await chromium.launch(this.options);
    this.system = await this.chromium.newBrowserCDPSession();
    this.pid = (await this.processes()).find(({ type }) => type === "browser").id;
    return this;
  }

  /**
   * A new session: an own store of tokens, an own size. `prepare` gets the page before it is loaded. Without `knot`, the
   * first visit has words and nothing to draw, as that of a service that is still making its knot.
   */
  async open(origin, { knot = false, ...options } = {}, prepare = async () => {}, path = "/") {
    const context = await this.chromium.newContext({ viewport: { width: 1000, height: 720 }, ...options });
    context.setDefaultTimeout(CALL_MS);
    const page = await context.newPage();
    const evaluate = page.evaluate.bind(page);
    // the only call that has no limit, as of a frame that never comes
    page.evaluate = async (...call) => await within("the page answers a function", CALL_MS, evaluate(...call));
    const complain = (text) => this.complaints.push(text);
    page.on("request", (request) => {
      const url = new URL(request.url());
      if (!["blob:", "data:"].includes(url.protocol) && url.origin !== origin) complain(`foreign request: ${url}`);
      if (url.search.includes("tess_")) complain(`a token in an address: ${url}`);
    });
    page.on("crash", () => complain("a page crashed"));
    page.on("pageerror", (error) => complain(`error: ${error.message}`));
    page.on("dialog", (dialog) => complain(`dialog: ${dialog.message()}`));
    page.on("console", (message) => {
      if (/Content Security Policy/i.test(message.text())) complain(`violation: ${message.text()}`);
    });
    if (this.files) await page.route(origin + "/**", (route) => this.fromFolder(route));
    if (!knot) await page.addInitScript(withoutKnot);
    await prepare(page);
    await page.goto(origin + path);
    return page;
  }

  /** Milliseconds of processors that processes of the browser took, of all types or some: not those of other programs. */
  async spent(types = null) {
    const some = (await this.processes()).filter(({ type }) => types?.includes(type) ?? true);
    return 1000 * some.reduce((sum, { cpuTime }) => sum + cpuTime, 0);
  }

  async processes() {
    return (await this.system.send("SystemInfo.getProcessInfo")).processInfo;
  }

  /** Answers with the file of the folder and the headers of the service. */
  async fromFolder(route) {
    const path = new URL(route.request().url()).pathname.slice(1);
    if (path !== "" && !FILES.includes(path)) return await route.fallback();
    const response = await route.fetch().catch(() => null);
    if (!response) return await route.abort();
    await route.fulfill({ response, body: readFileSync(join(this.files, path || "index.html")) });
  }

  async close() {
    try {
      await within("the browser closes", CLOSE_MS, this.chromium.close());
    } catch (error) {
      console.error(`${error.message}; it is killed`);
      process.kill(this.pid, "SIGKILL");
    }
  }
}

/** A picture of a page or an element, taken again where Chromium refuses one, as it sometimes does its first. */
export async function screenshot(target, options) {
  return await until("Chromium takes a picture", () =>
    target.screenshot(options).catch((error) => {
      if (!error.message.includes("Unable to capture screenshot")) throw error;
    }),
  );
}

/** Runs in a page: the knot is not there, whose pictures take more than a second of processors. */
function withoutKnot() {
  const { fetch } = window;
  const isKnot = (address) => /^knot\.(glb|tsr)$/.test(address);
  window.fetch = (address, ...rest) =>
    isKnot(address) ? Promise.resolve(new Response(null, { status: 404 })) : fetch(address, ...rest);
}

/** Runs in a page: notes when the first frame of a view, a selector, is there, as a pixel of it can be read. */
export function noteFirstFrame(view) {
  const look = () => {
    const canvas = document.querySelector(`${view} canvas`);
    if (window.firstFrame || !canvas?.dataset.frames) return;
    const gl = canvas.getContext("webgl2");
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    window.firstFrame = performance.now();
  };
  new MutationObserver(look).observe(document, { subtree: true, attributeFilter: ["data-frames"] });
}

/**
 * What an element, or the part of its width between `from` and `to`, looks like: `hues`, the number of 36 parts of the
 * circle of hues that at least a thousandth of its pixels have; `centre`, the colour of its middle; `light`, the mean of
 * the largest channels of the 40 × 40 pixels there; `ink`, the number of pixels as dark as outlines; `digest`, which
 * differs with any pixel. A picture that gets finer is waited for.
 */
export async function look(page, selector, from = 0, to = 1) {
  await until("the picture is settled", async () => !(await page.$(`${selector} canvas[data-settled=false]`)));
  const png = (await screenshot(page.locator(selector))).toString("base64");
  const read = async ([text, from, to]) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const image = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const [width, height] = [Math.floor((to - from) * image.width), image.height];
    const context = new OffscreenCanvas(width, height).getContext("2d");
    context.drawImage(image, -Math.floor(from * image.width), 0);
    const { data } = context.getImageData(0, 0, width, height);
    const counts = new Array(36).fill(0);
    let [digest, ink] = [0, 0];
    for (let i = 0; i < data.length; i += 4) {
      const [r, g, b] = data.subarray(i, i + 3);
      digest = (Math.imul(digest, 31) + (r << 16) + (g << 8) + b) | 0;
      const [high, low] = [Math.max(r, g, b), Math.min(r, g, b)];
      if (high < 32) ink += 1;
      if (high - low < 40) continue;
      const of = (shift, one, other) => shift + (one - other) / (high - low);
      const sector = high === r ? of(6, g, b) : high === g ? of(2, b, r) : of(4, r, g);
      counts[Math.floor(6 * sector) % 36] += 1;
    }
    const middle = 4 * (Math.floor(height / 2) * width + Math.floor(width / 2));
    const square = context.getImageData((width >> 1) - 20, (height >> 1) - 20, 40, 40).data;
    let light = 0;
    for (let i = 0; i < square.length; i += 4) light += Math.max(...square.subarray(i, i + 3)) / 1600;
    return {
      light,
      ink,
      hues: counts.filter((n) => 1000 * n > width * height).length,
      centre: [...data.subarray(middle, middle + 3)],
      digest,
    };
  };
  return await page.evaluate(read, [png, from, to]);
}
