// Writes uniform materials as folders of maps (8-bit PNG, 64 x 64 texels): materials.mjs DIR.
import { mkdirSync, writeFileSync } from 'node:fs';
import { deflateSync } from 'node:zlib';

const SIDE = 64;
const MATERIALS = {
  plaster: { diffuse: [0.5, 0.45, 0.4], specular: [0.04, 0.04, 0.04], roughness: 0.7 },
  plastic: { diffuse: [0.18, 0.18, 0.18], specular: [0.04, 0.04, 0.04], roughness: 0.5 },
  varnish: { diffuse: [0.3, 0.12, 0.05], specular: [0.2, 0.16, 0.1], roughness: 0.35 },
  gold: { diffuse: [0, 0, 0], specular: [0.9, 0.68, 0.3], roughness: 0.3 },
  // Roughness across the direction (degrees from X), strength as in KHR_materials_anisotropy.
  brushed: { diffuse: [0, 0, 0], specular: [0.6, 0.57, 0.53], roughness: 0.36, anisotropy: [25, 0.45] },
  lacquer: { diffuse: [0.2, 0.05, 0.03], specular: [0.06, 0.06, 0.06], roughness: 0.6, coat: [0.9, 0.25] },
  velvet: { diffuse: [0.12, 0.02, 0.04], specular: [0.03, 0.03, 0.03], roughness: 0.8, sheen: [0.5, 0.2, 0.3, 0.5] },
  satin: { diffuse: [0.2, 0.2, 0.25], specular: [0.05, 0.05, 0.05], roughness: 0.5, coat: [0.5, 0.3], sheen: [0.2, 0.3, 0.4, 0.8] },
  carbon: { diffuse: [0.03, 0.03, 0.03], specular: [0.1, 0.1, 0.1], roughness: 0.4, anisotropy: [-60, 0.5], coat: [1, 0.3] },
};

function chunk(name, data) {
  const body = Buffer.concat([Buffer.from(name), data]);
  const out = Buffer.alloc(8);
  out.writeUInt32BE(data.length, 0);
  out.writeUInt32BE(crc(body), 4);
  return Buffer.concat([out.subarray(0, 4), body, out.subarray(4)]);
}

// Debian 12's Node has no zlib.crc32.
function crc(bytes) {
  let value = ~0;
  for (const byte of bytes) {
    value ^= byte;
    for (let bit = 0; bit < 8; bit++) value = (value >>> 1) ^ (value & 1 ? 0xedb88320 : 0);
  }
  return ~value >>> 0;
}

function png(rgb) {
  const header = Buffer.alloc(13);
  header.writeUInt32BE(SIDE, 0);
  header.writeUInt32BE(SIDE, 4);
  header.set([8, 2, 0, 0, 0], 8);
  const row = Buffer.from([0, ...Array(SIDE).fill(rgb).flat()]);
  const rows = Buffer.concat(Array(SIDE).fill(row));
  const signature = Buffer.from([0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a]);
  const parts = [chunk('IHDR', header), chunk('IDAT', deflateSync(rows)), chunk('IEND', Buffer.alloc(0))];
  return Buffer.concat([signature, ...parts]);
}

const srgb = (v) => Math.round(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));

const byte = (v) => Math.round(255 * v);

for (const [name, { diffuse, specular, roughness, anisotropy, coat, sheen }] of Object.entries(MATERIALS)) {
  const dir = `${process.argv[2]}/${name}`;
  mkdirSync(dir, { recursive: true });
  writeFileSync(`${dir}/normal.png`, png([128, 128, 255]));
  writeFileSync(`${dir}/diffuse.png`, png(diffuse.map(srgb)));
  writeFileSync(`${dir}/specular.png`, png(specular.map(srgb)));
  writeFileSync(`${dir}/roughness.png`, png(Array(3).fill(byte(roughness))));
  if (anisotropy) {
    const angle = (anisotropy[0] * Math.PI) / 180;
    const direction = [Math.cos(angle), Math.sin(angle)].map((v) => byte(0.5 * v + 0.5));
    writeFileSync(`${dir}/anisotropy.png`, png([...direction, byte(anisotropy[1])]));
  }
  if (coat) writeFileSync(`${dir}/coat.png`, png([...coat.map(byte), 0]));
  if (sheen) {
    writeFileSync(`${dir}/sheen.png`, png(sheen.slice(0, 3).map(srgb)));
    writeFileSync(`${dir}/sheen_roughness.png`, png(Array(3).fill(byte(sheen[3]))));
  }
}
