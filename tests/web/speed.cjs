// Times photographs of the example in the page, with both libraries, and by the command line with one thread, in turns:
// wall time, and processor time of the browser's pages (the library, its compilation, the page itself).
// usage: node speed.cjs SVBRDF CHROMIUM [RUNS]
'use strict';
const { execFileSync } = require('node:child_process');
const { EXAMPLE, launch, openPage, serve, settled } = require('./page.cjs');

const [svbrdf, browserPath, runs = '3'] = process.argv.slice(2);
/** Photographs of a fit; the first has other phases than further ones. */
const FRAMES = 4;

const median = (values) => values.toSorted((a, b) => a - b)[Math.floor(values.length / 2)];

/** Seconds of the first photograph, and of one further on average: wall, processor. */
async function inPage(browser, address, library) {
  const { page, close } = await openPage(browser, address, { frames: FRAMES, library });
  const debug = await browser.newBrowserCDPSession();
  const processor = async () => {
    const { processInfo } = await debug.send('SystemInfo.getProcessInfo');
    return processInfo.filter((p) => p.type === 'renderer').reduce((sum, p) => sum + p.cpuTime, 0);
  };
  const used = [];
  await page.exposeFunction('settledNow', async () => used.push([performance.now() / 1000, await processor()]));
  await page.evaluate(async () => {
    const { scan } = window.svbrdfPage;
    await scan.ready();
    scan.addEventListener('settled', () => window.settledNow());
  });
  const begun = [performance.now() / 1000, await processor()];
  await page.click('#example');
  await settled(page, FRAMES);
  while (used.length < FRAMES) await new Promise((done) => setTimeout(done, 20));
  await debug.detach();
  await close();
  const between = (from, to) => to.map((v, i) => v - from[i]);
  return { first: between(begun, used[0]), further: between(used[0], used.at(-1)).map((v) => v / (FRAMES - 1)) };
}

/** The same of the command line. */
function native() {
  const fit = (frames) => {
    const command = `TIMEFORMAT='%R %U %S'; time "$0" fit "$1" --out "$(mktemp -d)" --frames ${frames} --threads 1 --quiet --no-report`;
    const said = execFileSync('bash', ['-c', `{ ${command}; } 2>&1`, svbrdf, EXAMPLE], { encoding: 'utf8' });
    const [wall, user, system] = said.trim().split('\n').at(-1).split(' ').map(Number);
    return [wall, user + system];
  };
  const [one, all] = [fit(1), fit(FRAMES)];
  return { first: one, further: all.map((v, i) => (v - one[i]) / (FRAMES - 1)) };
}

(async () => {
  const server = await serve();
  const browser = await launch(browserPath);
  const found = { native: [], simd128: [], relaxed: [] };
  for (let run = 0; run < Number(runs); run++) {
    for (const name of Object.keys(found)) found[name].push(name === 'native' ? native() : await inPage(browser, server.address, name));
  }
  await browser.close();
  await server.close();
  const [wall, processor] = [0, 1].map((kind) => (name) => found[name].map((run) => run.further[kind]));
  for (const name of Object.keys(found)) {
    const all = (values) => values.map((v) => v.toFixed(2)).join(', ');
    console.log(`${name}: a further photograph ${all(wall(name))} s, processor ${all(processor(name))} s; the first ${all(found[name].map((run) => run.first[0]))} s`);
    if (name !== 'native') {
      const times = (values) => (median(values(name)) / median(values('native'))).toFixed(2);
      console.log(`  times the command line's: ${times(wall)}, processor ${times(processor)} (medians)`);
    }
  }
})().catch((fault) => {
  console.error(fault);
  process.exit(1);
});
