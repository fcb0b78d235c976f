// The built page in a browser, for the scripts beside it.
'use strict';
const assert = require('node:assert/strict');
const fs = require('node:fs');
const http = require('node:http');
const path = require('node:path');
const { chromium } = require('playwright-core');

const ROOT = path.resolve('ffi/web/dist');
const EXAMPLE = path.resolve('examples/captures/tile');
/** A fit on a busy machine takes its time, milliseconds. */
const LONG = 300000;
const TYPES = { '.html': 'text/html', '.js': 'text/javascript', '.css': 'text/css', '.json': 'application/json', '.jpg': 'image/jpeg', '.png': 'image/png', '.webmanifest': 'application/manifest+json' };

/** A static server without special headers; `asked` has the names of files, in the order of requests. */
async function serve() {
  const asked = [];
  const server = http.createServer((request, response) => {
    const name = decodeURIComponent(new URL(request.url, 'http://x').pathname);
    asked.push(name);
    const file = path.join(ROOT, name.endsWith('/') ? `${name}index.html` : name);
    if (!file.startsWith(ROOT) || !fs.existsSync(file)) return response.writeHead(404).end();
    response.writeHead(200, { 'content-type': TYPES[path.extname(file)] ?? 'application/octet-stream' });
    fs.createReadStream(file).pipe(response);
  });
  await new Promise((done) => server.listen(0, '127.0.0.1', done));
  const close = () => (server.closeAllConnections(), new Promise((done) => server.close(done)));
  return { address: `http://127.0.0.1:${server.address().port}/`, asked, close };
}

const launch = (executablePath) => chromium.launch({
  executablePath,
  args: ['--headless', '--no-sandbox', '--disable-gpu', '--enable-unsafe-swiftshader', '--no-first-run', '--disable-background-networking', '--disable-component-update', '--disable-sync'],
});

/**
 * A page that must not complain, and asks nothing of other servers. `frames`: photographs of the example;
 * `library`: the one to load instead of the browser's choice; `context`: options of Playwright.
 */
async function openPage(browser, address, { frames, library, context: options = {} }) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 }, reducedMotion: 'reduce', acceptDownloads: true, ...options });
  context.setDefaultTimeout(LONG);
  const page = await context.newPage();
  const faults = [];
  page.on('console', (m) => m.type() === 'error' && faults.push(`console: ${m.text()}`));
  page.on('pageerror', (e) => faults.push(`uncaught: ${e.message}`));
  context.on('request', (r) => r.url().startsWith(address) || /^(data|blob):/.test(r.url()) || faults.push(`request: ${r.url()}`));
  await context.route('**/example/capture.json', async (route) => {
    const description = JSON.parse(fs.readFileSync(path.join(EXAMPLE, 'capture.json')));
    description.frames.length = frames;
    await route.fulfill({ json: description });
  });
  if (library) await context.route('**/library.js', (route) => route.fulfill({ contentType: 'text/javascript', body: `globalThis.svbrdfLibrary = '${library}';` }));
  await page.goto(address);
  await page.waitForFunction(() => window.svbrdfPage);
  return { page, context, close: async () => (await context.close(), assert.deepEqual(faults, [])) };
}

/** Waits until nothing is left to do. */
const settled = (page, count) => page.waitForFunction((n) => {
  const { scan } = window.svbrdfPage;
  return scan.photographs.length === n && scan.settled && !scan.pushing && scan.photographs.every((p) => p.state !== 'waiting');
}, count);

module.exports = { EXAMPLE, launch, openPage, serve, settled };
