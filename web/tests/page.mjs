// The page in Chromium against a real service:
//   node web/tests/page.mjs BINARY [--pictures FOLDER] [--files FOLDER] [--only REGEXP] [MESHES]
import assert from "node:assert/strict";
import { Browser } from "./browser.mjs";
import { images } from "./images.mjs";
import { reach } from "./reach.mjs";
import { results } from "./results.mjs";
import { design } from "./design.mjs";
import { sending } from "./sending.mjs";
import { Service, until } from "./service.mjs";
import { states } from "./states.mjs";
import { binary, values } from "./steps.mjs";
import { words } from "./words.mjs";

const tests = { ...results, ...images, ...design, ...reach, ...sending, ...states, ...words };

const browser = await new Browser(values.files).launch();
const service = await new Service(binary).start();
let failures = 0;
for (const [name, test] of Object.entries(tests)) {
  if (values.only && !new RegExp(values.only).test(name)) continue;
  const started = Date.now();
  try {
    await test({ service, browser });
    assert.deepEqual(browser.complaints.splice(0), []);
    console.log(`ok, ${((Date.now() - started) / 1000).toFixed(1)} s: ${name}`);
  } catch (error) {
    failures += 1;
    console.error(`FAILED: ${name}\n${error.stack}`);
    if (browser.complaints.length > 0) console.error(browser.complaints.splice(0).join("\n"));
  }
}
// what the tests above look for is found where it is
const page = await browser.open(service.url);
await page.evaluate(() => {
  document.body.append(Object.assign(document.createElement("script"), { textContent: "window.hit = 1" }));
  void fetch("http://127.0.0.2:9/").catch(() => {});
});
await until("violations are noticed", () => browser.complaints.some((text) => text.startsWith("violation")));
assert.equal(await page.evaluate(() => window.hit), undefined, "the policy does not stop inline scripts");
await browser.close();
await service.stop();
if (failures > 0) console.error(service.log.slice(-3000));
process.exit(failures > 0 ? 1 : 0);
