// Looks at a report in a browser, as tests/report.sh says.
// usage: node look.cjs SVBRDF MAPS_DIR CHROMIUM [PICTURES_DIR]
'use strict';
const assert = require('node:assert/strict');
const { execFileSync } = require('node:child_process');
const fs = require('node:fs');
const path = require('node:path');
const { pathToFileURL } = require('node:url');
const { chromium } = require('playwright-core');
const { PNG } = require('pngjs');

const [svbrdf, maps, browserPath, pictures] = process.argv.slice(2);
const addressOf = (name) => pathToFileURL(path.resolve(maps, name)).href;

/** Mean difference allowed between the viewer and the library, of 255. */
const SAME = 2;
/** The same where the viewer interpolates between texels, which `svbrdf render` does not. */
const INTERPOLATED = 6;

const srgb = (v) => 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);

/** The library's rendering, sRGB at an exposure: rows of [r, g, b]. */
function rendered(camera, light, sampleMm, exposure, folder = maps) {
  const out = path.join(maps, 'rendered.png');
  const list = (v) => v.map((x) => x.toFixed(6)).join(',');
  execFileSync(svbrdf, ['render', folder, '--camera-mm', list(camera), '--light-mm', list(light),
    '--sample-mm', String(Math.max(...sampleMm)), '--out', out]);
  const png = PNG.sync.read(fs.readFileSync(out), { skipRescale: true });
  const pixel = (x, y) => [0, 1, 2].map((c) => srgb(Math.min(1, (exposure * png.data[4 * (y * png.width + x) + c]) / 65535)));
  return { width: png.width, height: png.height, pixel };
}

/** A page that must not complain, and loads nothing but itself. */
async function open(browser, options = {}, prepare = () => {}, name = 'report.html') {
  const address = addressOf(name);
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 }, reducedMotion: 'reduce', offline: true, ...options });
  // Drawing without a graphics card on a busy machine takes its time.
  context.setDefaultTimeout(180000);
  const page = await context.newPage();
  const faults = [];
  page.on('console', (m) => ['error', 'warning'].includes(m.type()) && faults.push(`${m.type()}: ${m.text()}`));
  page.on('pageerror', (e) => faults.push(`uncaught: ${e.message}`));
  page.on('request', (r) => r.url() !== address && !r.url().startsWith('data:') && faults.push(`request: ${r.url().slice(0, 200)}`));
  await prepare(page);
  await page.goto(address);
  await page.waitForFunction(() => window.svbrdfReport);
  await page.evaluate(() => window.svbrdfReport.ready);
  return { page, close: async () => (await context.close(), assert.deepEqual(faults, [])) };
}

const state = (page) => page.evaluate(() => {
  const { light, view, stops, zoom } = window.svbrdfReport.stage;
  return { light, view, stops, zoom };
});
const settle = (page) => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));

/** The viewer, one texel a pixel, against the library: by a screenshot. */
async function sameAsLibrary(page, data, folder = maps) {
  const { width, height } = data.maps;
  await page.addStyleTag({ content: `#quad { position: fixed !important; inset: 0 auto auto 0 !important; z-index: 99; border-radius: 0 !important;
    width: ${width}px !important; height: ${height}px !important; }` });
  const longer = Math.max(...data.sample_mm);
  const own = [
    [[0, 0, 3], [0.9, 0.4, 1.1], 1], [[0, 0, 2], [-2, 0.3, 0.7], 1], [[0.8, -1.1, 1.6], [-0.7, 1.2, 1.5], 0.5],
    [[1.5, 0, 0.8], [-1.5, 0.2, 0.9], 0.7], [[-0.4, 0.2, 1], [-0.4, 0.25, 1], 1.5],
  ].map(([camera, light, exposure]) => ({ camera_mm: camera.map((v) => v * longer), light_mm: light.map((v) => v * longer), exposure }));
  let worst = 0;
  for (const { camera_mm, light_mm, exposure } of [...data.presets, ...own]) {
    await page.evaluate((s) => window.svbrdfReport.stage.viewer.set(s), { camera: camera_mm, light: light_mm, exposure, flat: true });
    await settle(page);
    const shot = PNG.sync.read(await page.screenshot({ clip: { x: 0, y: 0, width, height } }));
    const truth = rendered(camera_mm, light_mm, data.sample_mm, exposure, folder);
    assert.deepEqual([truth.width, truth.height], [width, height]);
    let [sum, bright] = [0, 0];
    for (let y = 0; y < height; y++) {
      for (let x = 0; x < width; x++) {
        const expected = truth.pixel(x, y);
        for (let c = 0; c < 3; c++) {
          // `svbrdf render` clips its picture at 1, before the exposure.
          if (exposure < 1 && expected[c] >= srgb(exposure) - 1) continue;
          sum += Math.abs(shot.data[4 * (y * width + x) + c] - expected[c]);
          bright += 1;
        }
      }
    }
    assert.ok(bright > width * height, 'most of the picture is below clipping');
    const mean = sum / bright;
    worst = Math.max(worst, mean);
    assert.ok(mean <= SAME, `camera ${camera_mm}, light ${light_mm}: mean difference ${mean.toFixed(2)} of 255`);
  }
  return worst;
}

/** The quad in perspective: where texels should be seen, by another formula, they have their colour. */
async function samePlace(page, data) {
  const side = 512;
  await page.addStyleTag({ content: `#quad { width: ${side}px !important; height: ${side}px !important; }` });
  const { width, height } = data.maps;
  const [w, h] = data.sample_mm;
  const [tilt, azimuth, distance] = [0.6, 2.2, 2.5 * Math.max(w, h)];
  const [st, ct, sa, ca] = [Math.sin(tilt), Math.cos(tilt), Math.sin(azimuth), Math.cos(azimuth)];
  const camera = [st * ca, st * sa, ct].map((v) => v * distance);
  const light = [30, 70, 150];
  await page.evaluate((s) => window.svbrdfReport.stage.viewer.set(s), { camera, light, exposure: 1, flat: false, zoom: 1 });
  await settle(page);
  const shot = PNG.sync.read(await page.screenshot({ clip: { x: 0, y: 0, width: side, height: side } }));
  const truth = rendered(camera, light, data.sample_mm, 1);
  let [sum, count] = [0, 0];
  for (let row = 6; row < height - 6; row += 3) {
    for (let column = 6; column < width - 6; column += 3) {
      const p = [((column + 0.5) / width - 0.5) * w, (0.5 - (row + 0.5) / height) * h];
      // Turn about z so that the camera's side is x, tilt about y, turn back.
      const [u, v] = [p[0] * ca + p[1] * sa, -p[0] * sa + p[1] * ca];
      const [tilted, depth] = [u * ct, distance - u * st];
      const [sx, sy] = [tilted * ca - v * sa, tilted * sa + v * ca];
      const focal = (0.92 * 2 * distance) / Math.max(w, h);
      const [px, py] = [(side / 2) * (1 + (focal * sx) / depth), (side / 2) * (1 - (focal * sy) / depth)].map(Math.floor);
      const expected = truth.pixel(column, row);
      for (let c = 0; c < 3; c++) sum += Math.abs(shot.data[4 * (py * side + px) + c] - expected[c]);
      count += 3;
    }
  }
  const mean = sum / count;
  assert.ok(mean <= INTERPOLATED, `in perspective: mean difference ${mean.toFixed(2)} of 255`);
  return mean;
}

/**
 * A page and a folder of maps like those of the fit, but with anisotropy, a coat and sheen: as `anisotropy.png`,
 * `coat.png`, `sheen.png` and `sheen_roughness.png` state them, and as the page has them. Returns the names of both.
 */
function withLobes() {
  const [angle, strength, weight, coat, fuzz] = [0.6, 0.5, 0.8, 0.3, 0.6];
  const sheen = [188, 137, 0]; // sRGB
  const [page, folder] = ['report-lobes.html', path.join(maps, 'lobes')];
  fs.mkdirSync(folder, { recursive: true });
  for (const name of ['normal', 'diffuse', 'specular', 'roughness']) fs.copyFileSync(path.join(maps, `${name}.png`), path.join(folder, `${name}.png`));
  const stored = PNG.sync.read(fs.readFileSync(path.join(maps, 'roughness.png')), { skipRescale: true });
  const { width, height } = stored;
  const picture = (texel) => {
    const png = new PNG({ width, height });
    for (let i = 0; i < width * height; i++) [...texel(i), 255].forEach((v, c) => (png.data[4 * i + c] = Math.round(v)));
    return PNG.sync.write(png);
  };
  const direction = [Math.cos(angle), Math.sin(angle)].map((v) => 127.5 * (v + 1));
  fs.writeFileSync(path.join(folder, 'anisotropy.png'), picture(() => [...direction, 255 * strength]));
  fs.writeFileSync(path.join(folder, 'coat.png'), picture(() => [255 * weight, 255 * coat, 0]));
  fs.writeFileSync(path.join(folder, 'sheen.png'), picture(() => sheen));
  fs.writeFileSync(path.join(folder, 'sheen_roughness.png'), picture(() => Array(3).fill(255 * fuzz)));
  // Alphas along and across the direction of a texel.
  const alphas = (i) => {
    const across = (stored.data[4 * i] / 65535) ** 2;
    return [across + (1 - across) * strength ** 2, across];
  };
  const uri = (png) => `data:image/png;base64,${png.toString('base64')}`;
  const html = fs.readFileSync(path.join(maps, 'report.html'), 'utf8');
  const [before, json, after] = html.split(/(?<=<script type="application\/json" id="data">)([^<]*)/);
  const data = JSON.parse(json);
  data.maps.roughness = uri(picture((i) => Array(3).fill(255 * (alphas(i)[0] * alphas(i)[1]) ** 0.25)));
  data.maps.anisotropy = uri(picture((i) => {
    const [along, across] = alphas(i);
    const step = (127 / data.maps.scale) * Math.log(along / across);
    return [128 + step * Math.cos(2 * angle), 128 + step * Math.sin(2 * angle), 0];
  }));
  data.maps.coat = uri(picture(() => [255 * weight, 255 * coat, 0]));
  data.maps.sheen = uri(picture(() => sheen));
  data.maps.sheen_roughness = uri(picture(() => Array(3).fill(255 * fuzz)));
  fs.writeFileSync(path.join(maps, page), before + JSON.stringify(data).replaceAll('<', '\\u003c') + after);
  return { page, folder };
}

/** Lobes in the viewer and among the maps. */
async function lobes(browser) {
  const { page: name, folder } = withLobes();
  const { page, close } = await open(browser, {}, () => {}, name);
  assert.equal(await page.locator('#maps canvas').count(), 7);
  await page.locator('#maps canvas').nth(4).hover({ position: { x: 20, y: 20 } });
  assert.match(await page.locator('#maps figcaption').nth(4).innerText(), /^Anisotropy\s+\d+\.\d : 1, wider along 3[45]°$/);
  assert.match(await page.locator('#maps figcaption').nth(5).innerText(), /^Coat\s+weight 0\.80, roughness 0\.30$/);
  assert.match(await page.locator('#maps figcaption').nth(6).innerText(), /^Sheen\s+0\.503, 0\.250, 0\.000, roughness 0\.60$/);
  const worst = await sameAsLibrary(page, await page.evaluate(() => window.svbrdfReport.data), folder);
  await close();
  return worst;
}

/** Mouse, keys, sliders, lightings. */
async function moves(page, data) {
  await page.evaluate(() => window.svbrdfReport.stage.preset(0));
  const box = await page.locator('#quad').boundingBox();
  const middle = [box.x + box.width / 2, box.y + box.height / 2];
  const drag = async (dx, dy) => {
    await page.mouse.move(...middle);
    await page.mouse.down();
    await page.mouse.move(middle[0] + dx / 2, middle[1] + dy / 2);
    await page.mouse.move(middle[0] + dx, middle[1] + dy);
    await page.mouse.up();
    await settle(page);
  };
  const before = await state(page);
  const shot = await page.locator('#quad').screenshot();
  await drag(120, -60);
  let now = await state(page);
  assert.ok(now.light[0] > before.light[0] + 5 && now.light[1] > before.light[1] + 2, 'the light follows right and up');
  assert.deepEqual(now.view, before.view);
  assert.ok(!shot.equals(await page.locator('#quad').screenshot()), 'the picture changes');
  await page.locator('.drag label', { hasText: 'View' }).click();
  await drag(-100, 0);
  assert.ok((await state(page)).view[0] > 5, 'the view turns');
  await page.locator('.drag label', { hasText: 'Light' }).click();
  await page.locator('#quad').focus();
  now = await state(page);
  await page.keyboard.press('ArrowLeft');
  assert.ok((await state(page)).light[0] < now.light[0], 'an arrow moves the light');
  await page.keyboard.press('Shift+ArrowUp');
  assert.ok((await state(page)).view[1] > now.view[1], 'Shift and an arrow move the view');
  await page.keyboard.press('+');
  assert.ok((await state(page)).zoom > 0);
  await page.locator('#exposure').focus();
  await page.keyboard.press('ArrowRight');
  assert.ok((await state(page)).stops > now.stops);
  await page.locator('#presets button').nth(3).click();
  now = await state(page);
  assert.ok(now.view[1] < -40 && now.light[1] > 40 && now.zoom === 0, 'a lighting sets everything');
  assert.equal(await page.locator('#presets button[aria-pressed=true]').count(), 1);
  await page.locator('.photograph button').first().click();
  assert.ok(Math.hypot(...(await state(page)).view) > 0 || data.photographs[0].view.off_top_deg < 1);
}

/** The slider over earlier moments. */
async function moments(page, data) {
  const map = page.locator('#maps canvas').nth(1);
  const fingerprint = () => map.evaluate((canvas) => canvas.toDataURL());
  const last = await fingerprint();
  await page.locator('#moment').focus();
  await page.keyboard.press('Home');
  await page.waitForFunction(() => document.getElementById('moment-text').textContent === '1 photograph');
  // Pictures are decoded in their own time.
  const shows = async (same) => page.waitForFunction(
    ([canvas, last, same]) => (canvas.toDataURL() === last) === same, [await map.elementHandle(), last, same],
  );
  await shows(false); // the first maps are others
  await page.keyboard.press('End');
  await shows(true); // the last maps are those of the beginning
  const fitted = data.photographs.filter((p) => p.status === 'accepted' && !p.held_out).length;
  assert.equal(await page.locator('#moment').getAttribute('max'), String(data.snapshots.length));
  assert.equal(data.snapshots.length, fitted - 1);
  // Values under the pointer.
  await map.hover({ position: { x: 20, y: 20 } });
  assert.match(await page.locator('#maps figcaption').nth(1).innerText(), /\d\.\d{3}, \d\.\d{3}, \d\.\d{3}/);
}

/** Rules of accessibility that a program can check, and no scrolling sideways. */
async function reads(page) {
  await page.addScriptTag({ path: require.resolve('axe-core/axe.min.js') }).catch(() => page.evaluate(fs.readFileSync(require.resolve('axe-core/axe.min.js'), 'utf8')));
  const found = await page.evaluate(async () => (await window.axe.run(document, { resultTypes: ['violations'] })).violations
    .map((v) => `${v.id}: ${v.nodes.map((n) => n.target.join(' ')).slice(0, 4).join(', ')} (${v.help})`));
  assert.deepEqual(found, []);
  const [wide, seen] = await page.evaluate(() => [document.documentElement.scrollWidth, innerWidth]);
  assert.ok(wide <= seen, `${wide} px wide, ${seen} px on the screen`);
}

async function main() {
  assert.ok(fs.statSync(path.join(maps, 'report.html')).size <= 3e6, 'at most 3 MB');
  const browser = await chromium.launch({ executablePath: browserPath, args: ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist'] });
  const { page, close } = await open(browser);
  const data = await page.evaluate(() => window.svbrdfReport.data);
  await moves(page, data);
  await moments(page, data);
  assert.equal(await page.locator('.photograph').count(), data.photographs.length);
  assert.equal(await page.locator('.photograph polygon.board').count(), data.photographs.filter((p) => p.outlines).length);
  assert.equal(await page.locator('#charts figure').count(), 3);
  assert.equal(await page.locator('#predictions figure').count(), 2);
  const mean = await sameAsLibrary(page, data);
  const inPlace = await samePlace(page, data);
  await close();
  const withThem = await lobes(browser);
  for (const colorScheme of ['light', 'dark']) {
    for (const width of [1280, 390]) {
      const { page, close } = await open(browser, { viewport: { width, height: 900 }, colorScheme, bypassCSP: true });
      await reads(page);
      if (pictures) {
        fs.mkdirSync(pictures, { recursive: true });
        await page.screenshot({ path: path.join(pictures, `report-${colorScheme}-${width}.png`), fullPage: true });
      }
      await close();
    }
  }
  // Without WebGL 2 there are pictures.
  const without = await open(browser, {}, (page) => page.addInitScript(() => {
    const own = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...rest) { return kind === 'webgl2' ? null : own.call(this, kind, ...rest); };
  }));
  const still = without.page.locator('#still');
  assert.ok(await still.isVisible());
  const shown = await still.getAttribute('src');
  await without.page.locator('#presets button').nth(1).click();
  assert.notEqual(await still.getAttribute('src'), shown);
  assert.ok(!(await without.page.locator('.sliders').isVisible()));
  await without.close();
  await browser.close();
  console.log(`report.html: viewer within ${mean.toFixed(2)} of 255 of \`svbrdf render\` (${inPlace.toFixed(2)} in perspective, ${withThem.toFixed(2)} with lobes), ${(fs.statSync(path.join(maps, 'report.html')).size / 1e6).toFixed(2)} MB`);
}

main().catch((fault) => {
  console.error(fault);
  process.exit(1);
});
