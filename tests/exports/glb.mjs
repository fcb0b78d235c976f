// Validates GLB files with Khronos' validator: no errors, warnings or hints.
import { readFileSync } from 'node:fs';
import validator from 'gltf-validator';

let faults = 0;
for (const path of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(path)));
  const { numErrors, numWarnings, numHints } = report.issues;
  console.log(`${path}: ${numErrors} errors, ${numWarnings} warnings, ${numHints} hints`);
  for (const issue of report.issues.messages) {
    console.log(`  ${issue.code} ${issue.pointer ?? ''}: ${issue.message}`);
  }
  faults += numErrors + numWarnings + numHints;
}
process.exit(faults ? 1 : 0);
