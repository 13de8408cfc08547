// Bundles the page into a folder: node bundle.mjs [FOLDER]. Seven files: document, two scripts,
// styles, two pictures, licences. `scene.js` has what draws; `page.js`, which is small, loads it.
// An error, and not a bundle that is too large, where the bundle leaves its budget.
import { readFileSync, writeFileSync, mkdirSync, copyFileSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";
import { build } from "esbuild";

const MOST_BYTES = 1_000_000;
const MOST_COMPRESSED_BYTES = 260_000;

const here = dirname(fileURLToPath(import.meta.url));
const out = resolve(process.argv[2] ?? join(here, "../target/web"));
mkdirSync(out, { recursive: true });

const result = await build({
  entryPoints: [...["page.ts", "scene.ts", "page.css"].map((name) => join(here, "src", name))],
  outdir: out,
  bundle: true,
  minify: true,
  format: "esm",
  external: ["./scene.js"],
  target: "es2022",
  legalComments: "none",
  metafile: true,
  logLevel: "warning",
});
for (const name of ["index.html", "mark.svg", "share.jpg"]) copyFileSync(join(here, "src", name), join(out, name));

// the licence of every package that a byte of the bundle comes from
const packages = new Set();
for (const input of Object.keys(result.metafile.inputs)) {
  const found = /node_modules\/((?:@[^/]+\/)?[^/]+)\//.exec(input);
  if (found) packages.add(found[1]);
}
const licences = [...packages].sort().map((name) => {
  const folder = join(here, "node_modules", name);
  const { version, license } = JSON.parse(readFileSync(join(folder, "package.json"), "utf8"));
  const text = readFileSync(join(folder, "LICENSE"), "utf8").trim();
  return `${name} ${version} (${license})\n\n${text}\n`;
});
writeFileSync(join(out, "licences.txt"), licences.join(`\n${"-".repeat(80)}\n\n`));

// of what the page loads, which `share.jpg` is no part of
let [bytes, compressed] = [0, 0];
for (const name of ["index.html", "page.js", "scene.js", "page.css", "mark.svg", "licences.txt"]) {
  const content = readFileSync(join(out, name));
  bytes += content.length;
  compressed += gzipSync(content).length;
}
console.log(`page: ${bytes} bytes, ${compressed} gzipped, with ${[...packages].sort().join(" and ")}`);
if (bytes > MOST_BYTES || compressed > MOST_COMPRESSED_BYTES) {
  console.error(`the page is larger than its budget: ${MOST_BYTES} bytes, ${MOST_COMPRESSED_BYTES} gzipped`);
  process.exit(1);
}
