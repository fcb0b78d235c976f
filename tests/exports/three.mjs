// Shows GLB files in three.js (headless Chromium) and compares them with `svbrdf render`.
//
//   three.mjs CASES LIMIT    CASES: a folder with NAME/material.glb and NAME/VIEW.exr, rendered for
//                            each view of views.json
//
// Every texel is one pixel: the camera looks straight down with a frustum that ends at the sample's
// edges, so that the picture is the top view seen from the camera's place, as the library renders it.
import { readFileSync, readdirSync } from 'node:fs';
import { createServer } from 'node:http';
import { dirname, join, resolve } from 'node:path';
import { createRequire } from 'node:module';
import { fileURLToPath } from 'node:url';
import { chromium } from 'playwright-core';

const cases = resolve(process.argv[2]);
const limit = Number(process.argv[3]);
const here = dirname(fileURLToPath(import.meta.url));
const views = JSON.parse(readFileSync(join(here, 'views.json')));
const three = join(dirname(createRequire(import.meta.url).resolve('three')), '..');

const page = `<!doctype html><script type="importmap">
{ "imports": { "three": "/three/build/three.module.js", "three/addons/": "/three/examples/jsm/" } }
</script><script type="module">
import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { EXRLoader } from 'three/addons/loaders/EXRLoader.js';

window.compare = async (name, view, index) => {
  const gltf = await new GLTFLoader().loadAsync('/cases/' + name + '/material.glb');
  const exr = new EXRLoader();
  exr.setDataType(THREE.FloatType);
  const known = await exr.loadAsync('/cases/' + name + '/' + index + '.exr');
  const { width, height } = known.image;
  const renderer = new THREE.WebGLRenderer();
  const target = new THREE.WebGLRenderTarget(width, height, { type: THREE.FloatType });
  const scene = new THREE.Scene();
  scene.add(gltf.scene);
  const size = new THREE.Box3().setFromObject(gltf.scene).getSize(new THREE.Vector3());
  const light = new THREE.PointLight(0xffffff, Math.PI, 0, 0);
  light.position.set(...view.light.map((mm) => mm / 1000));
  scene.add(light);
  const [x, y, z] = view.camera.map((mm) => mm / 1000);
  const camera = new THREE.PerspectiveCamera();
  camera.position.set(x, y, z);
  camera.updateMatrixWorld();
  const near = 0.5 * z, k = near / z;
  const [w, h] = [size.x / 2, size.y / 2];
  camera.projectionMatrix.makePerspective(
    k * (-w - x), k * (w - x), k * (h - y), k * (-h - y), near, 2 * z, camera.coordinateSystem);
  camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
  renderer.setRenderTarget(target);
  renderer.render(scene, camera);
  const shown = new Float32Array(4 * width * height);
  renderer.readRenderTargetPixels(target, 0, 0, width, height, shown);
  const data = known.image.data;
  let difference = 0, sum = 0, total = 0;
  // Both have their bottom row first.
  for (let i = 0; i < width * height; i++) {
    for (let c = 0; c < 3; c++) {
      difference += Math.abs(shown[4 * i + c] - data[4 * i + c]);
      sum += data[4 * i + c];
      total += shown[4 * i + c];
    }
  }
  renderer.dispose();
  return { ratio: total / sum, difference: difference / sum, mean: sum / (3 * width * height), revision: THREE.REVISION };
};
window.ready = true;
</script>`;

const server = createServer((request, response) => {
  const path = decodeURIComponent(request.url);
  try {
    if (path === '/') return response.setHeader('content-type', 'text/html').end(page);
    const [, root, ...rest] = path.split('/');
    const folder = { three, cases }[root];
    if (path.endsWith('.js')) response.setHeader('content-type', 'text/javascript');
    response.end(readFileSync(join(folder, ...rest)));
  } catch {
    response.writeHead(404).end();
  }
}).listen(0, '127.0.0.1');

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
  args: ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
});
let failed = false;
try {
  const tab = await browser.newPage();
  const complain = (text) => {
    console.log(`  ${text}`);
    failed = true;
  };
  tab.on('pageerror', (error) => complain(error.message));
  tab.on('console', (message) => message.type() === 'error' && !message.text().includes('404') && complain(message.text()));
  await tab.goto(`http://127.0.0.1:${server.address().port}/`, { timeout: 180_000 });
  await tab.waitForFunction('window.ready', null, { timeout: 180_000 });
  for (const name of readdirSync(cases).sort()) {
    for (const [index, view] of views.entries()) {
      const call = ([name, view, index]) => window.compare(name, view, index);
      const { ratio, difference, mean, revision } = await tab.evaluate(call, [name, view, index]);
      const good = difference <= limit && mean > 1e-3;
      console.log(
        `three.js r${revision} ${name} view ${index}: ${ratio.toFixed(3)} of the library's radiance, mean difference ${(100 * difference).toFixed(1)} %${good ? '' : ' FAILED'}`,
      );
      failed ||= !good;
    }
  }
} finally {
  await browser.close();
  server.close();
}
process.exit(failed ? 1 : 0);
