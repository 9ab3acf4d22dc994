// Opens an exported .glb with Khronos' own validator: no errors, no warnings.
//
//     node glb.mjs SPHERE.glb
import { readFileSync } from "node:fs";
import { validateBytes } from "gltf-validator";

const path = process.argv[2];
const { issues, info } = await validateBytes(new Uint8Array(readFileSync(path)));
for (const { severity, code, message, pointer } of issues.messages) console.error(`${path}: ${severity} ${code} ${message} ${pointer ?? ""}`);
if (issues.numErrors + issues.numWarnings > 0) process.exit(1);
console.log(`${path}: valid, ${info.totalTriangleCount} triangles, ${info.materialCount} material`);
