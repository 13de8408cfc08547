// Time from opening a job to the first frame of its mesh, in a page that is there already, and the processor time of it:
//   node web/tests/first-frame.mjs BINARY [--faces 1070000] [--runs 3] [--files FOLDER] [--picture FILE]
// Above 5,000,000 triangles the button that shows the mesh is pressed, and the time is from then on.
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { parseArgs } from "node:util";
import { Browser, noteFirstFrame, screenshot } from "./browser.mjs";
import { Service, until } from "./service.mjs";

const PATIENCE_MS = 600_000;

/** Clock ticks of Linux, a second. */
const TICKS = 100;

const { positionals, values } = parseArgs({
  allowPositionals: true,
  options: {
    faces: { type: "string", default: "1070000" },
    runs: { type: "string", default: "3" },
    files: { type: "string" },
    picture: { type: "string" },
  },
});

const [binary] = positionals;
const service = await new Service(binary).start();
const browser = await new Browser(values.files).launch();
const system = await browser.chromium.newBrowserCDPSession();

/** Seconds of processors that the service and the browser took. */
async function spent() {
  const { processInfo } = await system.send("SystemInfo.getProcessInfo");
  const stat = readFileSync(`/proc/${service.process.pid}/stat`, "utf8");
  const [user, kernel] = stat.slice(stat.lastIndexOf(")")).split(" ").slice(12, 14).map(Number);
  return { service: (user + kernel) / TICKS, browser: processInfo.reduce((sum, { cpuTime }) => sum + cpuTime, 0) };
}

const mesh = join(service.folder, "knot.glb");
execFileSync(binary, ["sample", "knot", "--faces", values.faces, mesh], { stdio: "ignore" });
const answer = await fetch(`${service.url}/v1/jobs?clusters=1000&quality=fast&keep_mesh=true`, {
  method: "POST",
  headers: { "content-type": "model/gltf-binary" },
  body: readFileSync(mesh),
});
const { id } = await answer.json();
const ended = async () => (await (await fetch(`${service.url}/v1/jobs/${id}`)).json()).state === "succeeded";
await until("the job succeeds", ended, PATIENCE_MS);
for (let run = 0; run < Number(values.runs); run++) {
  const page = await browser.open(service.url, { knot: true }, (page) => page.addInitScript(noteFirstFrame, "#view"));
  await page.waitForSelector("#jobs a");
  await until("what draws is loaded", () => page.evaluate(() => performance.getEntriesByName(`${origin}/scene.js`)[0]));
  const before = await spent();
  let began = await page.evaluate((id) => {
    location.hash = `#/jobs/${id}`;
    return performance.now();
  }, id);
  if (Number(values.faces) > 5_000_000) {
    const button = page.locator("#view button");
    await button.waitFor();
    if (run === 0) console.log(`  ${await button.textContent()}`);
    began = await page.evaluate(() => {
      document.querySelector("#view button").click();
      return performance.now();
    });
  }
  const there = await until("the first frame is there", () => page.evaluate(() => window.firstFrame), PATIENCE_MS);
  const after = await spent();
  const took = Object.keys(after).map((name) => `${name} ${(after[name] - before[name]).toFixed(2)} s`);
  console.log(`first frame after ${Math.round(there - began)} ms; processor time: ${took.join(", ")}`);
  if (values.picture && run === 0) await screenshot(page, { path: values.picture });
  await page.close();
}
for (const complaint of browser.complaints) console.error(complaint);
await browser.close();
await service.stop();
