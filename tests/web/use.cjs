// Uses the web page in a browser, as tests/web.sh says.
// usage: node use.cjs SVBRDF WORK_DIR CHROMIUM [PICTURES_DIR]
'use strict';
const assert = require('node:assert/strict');
const { execFileSync } = require('node:child_process');
const fs = require('node:fs');
const path = require('node:path');
const validator = require('gltf-validator');
const { EXAMPLE: example, launch, openPage, serve, settled } = require('./page.cjs');

const [svbrdf, work, browserPath, pictures] = process.argv.slice(2);
const heic = process.env.HEIC === '1';
/** Photographs of the example that are fitted. */
const FRAMES = 3;
/** Root mean square by which maps may differ from those of other vector instructions: of one photograph; and of more, where
 * rounding decides after which step a fit has converged. With and without AVX2 the command line's differ by 4e-4; and by up to .011. */
const SAME = [1e-3, 0.02];
/** The same between both libraries, for one photograph: they differ as processors with and without fused multiply-add do. */
const RELAXED = 1e-3;

const photographs = (page) => page.evaluate(() => window.svbrdfPage.scan.photographs.map(({ name, state, row, place }) => ({ name, state, row, place })));
/** A page with the example's first photographs. */
const open = (browser, address, options = {}, frames = FRAMES) => openPage(browser, address, { frames, ...options });

async function download(page, name) {
  const [file] = await Promise.all([page.waitForEvent('download'), page.click(`button[data-file="${name}"]`)]);
  assert.equal(file.suggestedFilename(), name);
  const to = path.join(work, 'page', name);
  fs.mkdirSync(path.dirname(to), { recursive: true });
  await file.saveAs(to);
  return fs.readFileSync(to);
}

/** Root mean squares of the differences between the maps of two folders, one a map. */
function distances(a, b) {
  const difference = JSON.parse(execFileSync(svbrdf, ['compare', a, b, '--json']));
  const rms = ['normal', 'diffuse', 'specular', 'roughness', 'render'].map((name) => difference[name]);
  assert.ok(rms.every(Number.isFinite), JSON.stringify(difference));
  return rms;
}

/** The example's first photographs: as the command line fits them. */
async function exampleAsNative(page, frames) {
  await page.evaluate(() => {
    window.told = [];
    window.svbrdfPage.scan.addEventListener('progress', ({ detail }) => window.told.push(detail.fraction));
  });
  const begun = Date.now();
  await page.click('#example');
  await page.waitForSelector('#result:not([hidden])');
  const first = (Date.now() - begun) / 1000;
  await settled(page, frames);
  const all = (Date.now() - begun) / 1000;
  assert.deepEqual((await photographs(page)).map((p) => p.state), Array(frames).fill('accepted'));
  // One bar for all of them, which never goes back.
  const told = await page.evaluate(() => window.told);
  assert.deepEqual(told, [...told].sort((a, b) => a - b));
  assert.ok(told[0] < 1.001 / frames && told.at(-1) === 1, `${told}`);
  const bytes = await page.evaluate(() => window.svbrdfPage.scan.bytes);
  const native = path.join(work, `native-${frames}`);
  const start = Date.now();
  execFileSync(svbrdf, ['fit', example, '--out', native, '--frames', String(frames), '--threads', '1', '--quiet']);
  const nativeSeconds = (Date.now() - start) / 1000;
  for (const name of ['maps.exr', 'normal.png', 'diffuse.png', 'specular.png', 'roughness.png']) await download(page, name);
  const rms = distances(path.join(work, 'page'), native);
  assert.ok(rms.every((value) => value < SAME[Math.min(frames, 2) - 1]), `maps differ: ${rms}`);

  const taken = (report) => report.frames.map((f) => f.first_maps_seconds.toFixed(2)).join(', ');
  const [mine, theirs] = [await download(page, 'report.json'), fs.readFileSync(path.join(native, 'report.json'))].map((r) => JSON.parse(r));
  console.log(`${frames} photographs: page ${first.toFixed(1)} s to the first maps, ${all.toFixed(1)} s to the last; command line with one thread, its start and files included, ${nativeSeconds.toFixed(1)} s; ${(bytes / 2 ** 20).toFixed(0)} MiB of WebAssembly memory`);
  console.log(`  taking in: page ${taken(mine)} s, command line ${taken(theirs)} s; largest difference of the maps ${Math.max(...rms).toExponential(1)}`);
}

/** The maps of one photograph from the library that the browser has chosen, against those of the other. */
async function bothLibraries(browser, address) {
  const made = [];
  for (const library of [undefined, 'simd128']) {
    const { page, close } = await open(browser, address, { library }, 1);
    await page.click('#example');
    await settled(page, 1);
    assert.equal(await page.evaluate(() => window.svbrdfPage.scan.library), library ?? 'relaxed');
    const to = path.join(work, `of-${library}`);
    fs.mkdirSync(to);
    for (const name of ['maps.exr', 'normal.png', 'diffuse.png', 'specular.png', 'roughness.png']) fs.writeFileSync(path.join(to, name), await download(page, name));
    made.push(to);
    await close();
  }
  const rms = distances(...made);
  assert.ok(rms.every((value) => value < RELAXED), `maps differ: ${rms}`);
  assert.ok(rms.some((value) => value > 0), 'both libraries are the same');
  console.log(`with and without fused multiply-add, maps of one photograph differ by ${Math.max(...rms).toExponential(1)}`);
}

/** Files that programs open. */
async function filesAreValid(page) {
  const glb = await download(page, 'material.glb');
  const { issues } = await validator.validateBytes(new Uint8Array(glb));
  assert.equal(issues.numErrors + issues.numWarnings, 0, JSON.stringify(issues.messages));
  const usdz = await download(page, 'material.usdz');
  assert.equal(usdz.subarray(0, 4).toString('latin1'), 'PK\u0003\u0004');
  assert.equal(usdz.subarray(usdz.length - 22, usdz.length - 18).toString('latin1'), 'PK\u0005\u0006');
  for (const paper of ['a4', 'letter']) {
    const pdf = (await download(page, `board-${paper}.pdf`)).toString('latin1');
    assert.ok(pdf.startsWith('%PDF-') && pdf.trimEnd().endsWith('%%EOF'));
  }
  assert.match(await page.textContent('#maps'), /±/);
}

/** Maps after each number of photographs. */
async function earlierMaps(page) {
  const pixels = () => page.evaluate(() => [...document.getElementById('map-diffuse').getContext('2d').getImageData(0, 0, 64, 64).data].join());
  const last = await pixels();
  await page.focus('#moment');
  await page.keyboard.press('Home');
  assert.equal(await page.textContent('#moment-text'), '1 photograph');
  assert.notEqual(await pixels(), last);
  await page.keyboard.press('End');
  assert.equal(await pixels(), last);
}

/** The picture file `like` as a JPEG of `size`, or its own; or all gray. */
async function redrawn(page, like, { size, gray } = {}) {
  const url = `data:image/${path.extname(like).slice(1)};base64,${fs.readFileSync(like).toString('base64')}`;
  const bytes = await page.evaluate(async ({ url, size, gray }) => {
    const image = new Image();
    image.src = url;
    await image.decode();
    const [width, height] = size ?? [image.width, image.height];
    const canvas = new OffscreenCanvas(width, height);
    const context = canvas.getContext('2d');
    context.fillStyle = '#777';
    if (gray) context.fillRect(0, 0, width, height);
    else context.drawImage(image, 0, 0, width, height);
    const blob = await canvas.convertToBlob({ type: 'image/jpeg', quality: 0.9 });
    return [...new Uint8Array(await blob.arrayBuffer())];
  }, { url, size, gray });
  return Buffer.from(bytes);
}

/** A picture as phones keep it, by an encoder of others. */
function asHeic(file) {
  const to = path.join(work, 'camera-roll.heic');
  execFileSync('heif-enc', ['-q', '95', '-o', to, file]);
  return to;
}

/** Photographs without a description, one of them as HEIC, a picture of another camera, one without a board, a file that is none. */
async function photographsOfOnesOwn(page) {
  const capture = path.join(work, 'capture');
  execFileSync(svbrdf, ['simulate', path.join(example, 'truth'), '--out', capture, '--frames', '2', '--seed', '1']);
  const description = JSON.parse(fs.readFileSync(path.join(capture, 'capture.json')));
  const broken = path.join(work, 'broken.jpg');
  fs.writeFileSync(broken, 'not a picture');
  const unsupported = path.join(work, 'photo.heic');
  fs.writeFileSync(unsupported, Buffer.concat([Buffer.from('\0\0\0\x14ftypavif\0\0\0\0avif', 'latin1'), Buffer.alloc(4000)]));
  const frames = description.frames.map((frame) => path.join(capture, frame.image));
  if (heic) frames[1] = asHeic(frames[1]);
  const empty = path.join(work, 'empty.jpg');
  fs.writeFileSync(empty, await redrawn(page, frames[0], { gray: true }));
  const files = [...frames, empty, path.resolve('docs/tile.jpg'), broken, unsupported];
  await page.setInputFiles('#choose', files);
  await settled(page, files.length);
  const found = await photographs(page);
  assert.deepEqual(found.map((p) => p.state), ['accepted', 'accepted', ...Array(4).fill('rejected')]);
  assert.deepEqual(found.slice(2).map((p) => p.row.reason), ['board_not_found', 'other_camera', 'unreadable', 'unreadable']);
  assert.match(found[5].row.hint, /AVIF.*convert/);
  for (const { place } of found.slice(0, 2)) {
    assert.equal(place.sample.length, 24);
    assert.ok(place.sample.flat().every((v) => v > 0 && v < 1));
  }
  const told = await page.textContent('.photograph.is-rejected .text');
  assert.match(told, /not used/);
  assert.ok(found[2].row.hint.length > 10 && told.includes(found[2].row.hint.slice(1, 30)));
}

/** A worker that is lost takes no photograph with it. */
async function lostWorker(page) {
  await page.evaluate(() => {
    const { scan } = window.svbrdfPage;
    scan.pushing = scan.photographs[1];
    scan.on_fault({ id: scan.photographs[1].id, lost: true, text: 'memory' });
  });
  await page.waitForFunction(() => window.svbrdfPage.scan.photographs[0].state === 'accepted' && window.svbrdfPage.scan.settled);
  const found = await photographs(page);
  assert.deepEqual(found.map((p) => p.state), ['accepted', ...Array(5).fill('rejected')]);
  assert.match(found[1].row.hint, /memory/);
  assert.match(await page.textContent('#fault'), /began anew/);
}

/** Once loaded the page needs no network, and has the photographs that were in the scan. */
async function reloadedOffline({ page, context }) {
  await page.evaluate(() => navigator.serviceWorker.ready);
  // The browser drops rejected photographs in its own time.
  await page.waitForFunction(async () => (await (await import('./kept.js')).kept()).length === 1);
  await context.setOffline(true);
  await page.reload();
  await page.waitForFunction(() => window.svbrdfPage);
  assert.match(await page.textContent('#kept-text'), /^1 photograph of your last scan/);
  await page.click('#kept-use');
  await settled(page, 1);
  assert.deepEqual((await photographs(page)).map((p) => p.state), ['accepted']);
  assert.ok(await page.isHidden('#kept'));
  await page.click('#restart');
  await page.waitForFunction(async () => (await (await import('./kept.js')).kept()).length === 0);
  await page.reload();
  await page.waitForFunction(() => window.svbrdfPage);
  assert.ok(await page.isHidden('#kept'));
  await context.setOffline(false);
}

/** A page that was visited once, never used, and whose server is gone. */
async function offlineAfterFirstVisit(browser) {
  const server = await serve();
  const { page, close } = await open(browser, server.address);
  await page.evaluate(() => navigator.serviceWorker.ready);
  await page.waitForFunction(() => navigator.serviceWorker.controller);
  assert.ok(server.asked.includes('/relaxed.bin') && !server.asked.includes('/simd128.bin'), 'one library is kept');
  await installable(page);
  await server.close();
  await page.reload();
  await page.waitForFunction(() => window.svbrdfPage);
  await page.click('#example');
  await page.waitForSelector('#result:not([hidden])');
  await close();
}

/** What browsers ask of a page before they offer to put it on the home screen. */
async function installable(page) {
  const debug = await page.context().newCDPSession(page);
  const { url, errors } = await debug.send('Page.getAppManifest');
  assert.ok(url.endsWith('/app.webmanifest') && errors.length === 0, JSON.stringify(errors));
  const { installabilityErrors } = await debug.send('Page.getInstallabilityErrors');
  const found = installabilityErrors.map((e) => e.errorId);
  // Each context of these tests is a private window.
  assert.deepEqual(found.filter((id) => id !== 'in-incognito'), []);
}

/** Browsers stop pages in the background. */
async function stopped(page, context) {
  const debug = await context.newCDPSession(page);
  await page.click('#example');
  await page.waitForSelector('#result:not([hidden])');
  await debug.send('Page.setWebLifecycleState', { state: 'frozen' });
  await new Promise((done) => setTimeout(done, 1500));
  await debug.send('Page.setWebLifecycleState', { state: 'active' });
  await settled(page, FRAMES);
  assert.deepEqual((await photographs(page)).map((p) => p.state), Array(FRAMES).fill('accepted'));
}

/** The largest photographs of phones. */
async function largePhotograph(page) {
  const capture = path.join(work, 'capture');
  const { frames } = JSON.parse(fs.readFileSync(path.join(capture, 'capture.json')));
  const buffer = await redrawn(page, path.join(capture, frames[0].image), { size: [8064, 6048] });
  await page.setInputFiles('#choose', { name: 'large.jpg', mimeType: 'image/jpeg', buffer });
  await settled(page, 1);
  const [{ state, row }] = await photographs(page);
  assert.equal(state, 'accepted', JSON.stringify(row));
  const bytes = await page.evaluate(() => window.svbrdfPage.scan.bytes);
  console.log(`48 megapixels: taken in after ${row.seconds.toFixed(1)} s; ${(bytes / 2 ** 20).toFixed(0)} MiB of WebAssembly memory`);
}

/** Of a folder that is dropped, its pictures. */
async function droppedFolder(page) {
  const names = await page.evaluate(async () => {
    const { dropped } = await import('./dropped.js');
    const file = (name) => ({ name, isDirectory: false, file: (done) => done(new File([], name)) });
    const folder = (...entries) => ({
      name: 'folder',
      isDirectory: true,
      createReader: () => ({ readEntries: (done) => done(entries.splice(0, 2)) }),
    });
    const entries = [folder(file('b10.JPG'), file('b2.jpg'), file('notes.txt'), folder(file('deep.heic'))), file('single')];
    return (await dropped({ items: entries.map((entry) => ({ webkitGetAsEntry: () => entry })) })).map((f) => f.name);
  });
  assert.deepEqual(names.sort(), ['b10.JPG', 'b2.jpg', 'deep.heic', 'single']);
}

async function accessible(page) {
  // Through the debugger: the page's policy forbids scripts of others.
  await page.evaluate(fs.readFileSync(require.resolve('axe-core'), 'utf8'));
  const { violations } = await page.evaluate(() => window.axe.run(document, { runOnly: ['wcag2a', 'wcag2aa'] }));
  assert.deepEqual(violations.map((v) => `${v.id}: ${v.nodes.map((n) => n.html).join(' ')}`), []);
}

const fits = (page) => page.evaluate(() => document.documentElement.scrollWidth <= document.documentElement.clientWidth);
const picture = async (page, name) => pictures && (await page.screenshot({ path: path.join(pictures, `${name}.png`), fullPage: true }));

(async () => {
  if (pictures) fs.mkdirSync(pictures, { recursive: true });
  const server = await serve();
  const browser = await launch(browserPath);
  try {
    const one = await open(browser, server.address, {}, 1);
    await exampleAsNative(one.page, 1);
    await one.close();

    await bothLibraries(browser, server.address);
    await offlineAfterFirstVisit(browser);

    const begun = Date.now();
    const desktop = await open(browser, server.address);
    await picture(desktop.page, 'start');
    await desktop.page.evaluate(() => window.svbrdfPage.scan.ready());
    console.log(`library loaded and ready ${((Date.now() - begun) / 1000).toFixed(1)} s after the page was asked for`);
    await exampleAsNative(desktop.page, FRAMES);
    await filesAreValid(desktop.page);
    await earlierMaps(desktop.page);
    assert.ok(await fits(desktop.page));
    await picture(desktop.page, 'desktop');
    await desktop.close();

    const phone = await open(browser, server.address, { context: { viewport: { width: 390, height: 844 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true, colorScheme: 'dark' } });
    assert.equal(await phone.page.getAttribute('#camera', 'capture'), 'environment');
    await photographsOfOnesOwn(phone.page);
    assert.ok(await fits(phone.page), 'wider than a phone');
    await picture(phone.page, 'phone');
    await lostWorker(phone.page);
    await reloadedOffline(phone);
    await phone.close();

    const plain = await open(browser, server.address);
    await droppedFolder(plain.page);
    await stopped(plain.page, plain.context);
    await accessible(plain.page);
    await plain.close();

    const large = await open(browser, server.address);
    await largePhotograph(large.page);
    await large.close();
    console.log('the web page works');
  } finally {
    await browser.close();
    server.close();
  }
})().catch((fault) => {
  console.error(fault);
  process.exit(1);
});
