// Khronos' validator: prints, as JSON, the numbers of errors and warnings of each GLB file that is named.
//
//     node validate.mjs MODULES FILE.glb…      MODULES is the folder that npm installed gltf-validator into
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';

const [modules, ...files] = process.argv.slice(2);
const validator = createRequire(`${modules}/`)('gltf-validator');
const found = {};
for (const file of files) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(file)));
  const { numErrors, numWarnings, messages } = report.issues;
  const severe = messages.filter(({ severity }) => severity < 2).map(({ code, pointer }) => `${code} at ${pointer}`);
  found[file] = { errors: numErrors, warnings: numWarnings, severe: severe.slice(0, 5) };
}
console.log(JSON.stringify(found));
