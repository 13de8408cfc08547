// Pictures of the page's states for people to look at, in three sizes, light and dark:
//   node web/tests/gallery.mjs BINARY FOLDER [--files FOLDER] [--only REGEXP]
import { execFileSync } from "node:child_process";
import { mkdirSync, readFileSync } from "node:fs";
import { basename, join } from "node:path";
import { parseArgs } from "node:util";
import { Browser, screenshot } from "./browser.mjs";
import { Service, until } from "./service.mjs";

const SIZES = [
  [1280, 720],
  [1920, 1080],
  [390, 844],
];

const { positionals, values } = parseArgs({
  allowPositionals: true,
  options: { files: { type: "string" }, only: { type: "string", default: "" } },
});
const [binary, folder] = positionals;
mkdirSync(folder, { recursive: true });
const service = await new Service(binary).start();
const browser = await new Browser(values.files).launch();

/** Hills as OBJ: GLB says that y is up. */
function sample(name, faces) {
  const path = join(service.folder, `${name}.${name === "terrain" ? "obj" : "glb"}`);
  execFileSync(binary, ["sample", name, "--faces", String(faces), path]);
  return path;
}

/** Makes a job of a sample; its number. */
async function job(name, faces, query) {
  const form = new FormData();
  const path = sample(name, faces);
  form.append("mesh", new Blob([readFileSync(path)]), basename(path));
  const url = `${service.url}/v1/jobs?keep_mesh=true&${query}`;
  const made = await (await fetch(url, { method: "POST", body: form })).json();
  if (!made.id) throw new Error(JSON.stringify(made));
  return made.id;
}
/** Makes a job of a JPEG file; its number. */
async function photo(path) {
  const url = `${service.url}/v1/jobs?clusters=500&outputs=means,clusters.csv`;
  const headers = { "Content-Type": "image/jpeg" };
  return (await (await fetch(url, { method: "POST", headers, body: readFileSync(path) })).json()).id;
}
const ended = (id) =>
  until("the job ends", async () =>
    /succeeded|failed/.test((await (await fetch(`${service.url}/v1/jobs/${id}`)).json()).state),
  );

/** Takes the pictures of a state: where it is, and what is done there and until when. */
async function take(name, address, reach) {
  if (!new RegExp(values.only).test(name)) return;
  for (const [width, height] of SIZES) {
    const options = { viewport: { width, height }, reducedMotion: "reduce", knot: true };
    const page = await browser.open(service.url, options, undefined, `/#${address}`);
    await reach(page);
    for (const colorScheme of ["light", "dark"]) {
      await page.emulateMedia({ colorScheme });
      // until the picture rests
      await page.waitForTimeout(1200);
      await screenshot(page, { path: join(folder, `${name}-${width}-${colorScheme}.png`) });
    }
    await page.close();
  }
}
const drawn = (selector) => async (page) =>
  await until("it is drawn", () =>
    page.evaluate((name) => Number(document.querySelector(`${name} canvas`)?.dataset.frames) > 0, selector),
  );
const frames = drawn("#view");

await take("empty", "/", drawn("#knot"));
const flat = await job("knot", 30_000, "clusters=400");
const other = await job("knot", 30_000, "clusters=400&quality=fast");
const tree = await job("terrain", 40_000, "algorithm=pml");
const failed = await job("parts", 3000, "clusters=1");
const shapes = await job("part", 12_000, "clusters=13&energy=shapes");
const image = await photo(join(import.meta.dirname, "../../docs/images.jpg"));
for (const id of [flat, other, tree, failed, shapes, image]) await ended(id);
await take("first-visit", "/", drawn("#knot"));
await take("result", `/jobs/${flat}`, frames);
await take("picked", `/jobs/${flat}?cluster=120`, frames);
await take("hierarchy", `/jobs/${tree}?clusters=160`, frames);
await take("card", `/jobs/${tree}?clusters=160&colours=area`, async (page) => {
  await page.waitForSelector("#view canvas[data-settled=true]");
  await page.click("#view canvas");
});
await take("compare", `/jobs/${flat}?with=${other}`, frames);
await take("wipe", `/jobs/${flat}?with=${other}&parting=wipe`, frames);
await take("shapes", `/jobs/${shapes}?colours=shape&cluster=2`, frames);
await take("image", `/jobs/${image}`, (page) => page.waitForSelector("#view canvas"));
await take("error", `/jobs/${failed}`, (page) => page.waitForSelector("#state[data-state=failed]"));
await take("running", "/", async (page) => {
  await page.setInputFiles("#file", sample("knot", 290_000));
  await page.selectOption("#algorithm", "bb");
  await page.selectOption("#quality", "best");
  await page.fill("#clusters", "2000");
  await page.click("#submit");
  await page.waitForSelector("#preview[data-shown]");
});
await browser.close();
await service.stop();
