// The page in Chromium against a real service:
//   node web/tests/page.mjs BINARY [--pictures FOLDER] [--files FOLDER] [--only REGEXP] [MESHES]
//   node web/tests/page.mjs BINARY --times, what it takes at most
import assert from "node:assert/strict";
import { Browser } from "./browser.mjs";
import { cuts } from "./cuts.mjs";
import { images } from "./images.mjs";
import { reach } from "./reach.mjs";
import { results } from "./results.mjs";
import { deletions } from "./deletions.mjs";
import { design } from "./design.mjs";
import { ends } from "./ends.mjs";
import { sending } from "./sending.mjs";
import { Service, awaited, until, within } from "./service.mjs";
import { states } from "./states.mjs";
import { binary, values } from "./steps.mjs";
import { times } from "./times.mjs";
import { words } from "./words.mjs";

/** Most time of a test, which is longer than that of every wait in it. */
const DEADLINE_MS = 6 * 60_000;

/** What a page must not do. */
const forbidden = {
  async "what a page must not do is noticed"({ service, browser }) {
    const page = await browser.open(service.url);
    await page.evaluate(() => {
      document.body.append(Object.assign(document.createElement("script"), { textContent: "window.hit = 1" }));
      void fetch("http://127.0.0.2:9/").catch(() => {});
    });
    await until("it is noticed", () => browser.complaints.some((text) => text.startsWith("violation")));
    assert.equal(await page.evaluate(() => window.hit), undefined, "the policy does not stop inline scripts");
    await page.close();
    browser.complaints.length = 0;
  },
};

/** Tests of the first two groups go on with jobs of those before; the others begin without jobs, of which every page
 * makes small pictures. */
const goOn = [{ ...results, ...reach }, design];
const groups = values.times ? [times] : [...goOn, images, cuts, sending, states, ends, deletions, words, forbidden];

const browser = await new Browser(values.files, { mesa: !values.times }).launch();
const service = await new Service(binary).start();
let failures = 0;
process.on("unhandledRejection", (error) => {
  failures += 1;
  console.error(`FAILED beside a test\n${error.stack}`);
});

async function run(name, test) {
  const started = Date.now();
  try {
    await within("the test ends", DEADLINE_MS, test({ service, browser }));
    assert.deepEqual(browser.complaints.splice(0), []);
    console.log(`ok, ${((Date.now() - started) / 1000).toFixed(1)} s: ${name}`);
  } catch (error) {
    failures += 1;
    console.error(`FAILED: ${name}\n${error.stack}`);
    for (const what of awaited) console.error(`still awaited: ${what}`);
    for (const complaint of browser.complaints) console.error(complaint);
    // either may hang, and the next test needs both; what is still awaited ends with them
    await browser.close();
    await service.kill();
    await browser.launch();
    await service.again();
    awaited.clear();
    browser.complaints.length = 0;
  }
}

for (const group of groups) {
  for (const [name, test] of Object.entries(group)) {
    if (values.only && !new RegExp(values.only).test(name)) continue;
    await run(name, test);
    if (!goOn.includes(group)) await service.empty();
  }
  await service.empty();
}
await browser.close();
await service.stop();
if (failures > 0) console.error(service.log.slice(-3000));
process.exit(failures > 0 ? 1 : 0);
