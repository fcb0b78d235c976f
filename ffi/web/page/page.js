import { dropped } from './dropped.js';
import { clear, drop, keep, kept } from './kept.js';
import './library.js';
import { MapsView } from './maps.js';
import { Scan } from './scan.js';
import { photographCard } from './photographs.js';

const { libraries, networks } = await (await fetch('sizes.json')).json();
const library = globalThis.svbrdfLibrary;
const sizes = { [`${library}.bin`]: libraries[`${library}.bin`], ...networks };
const megabytes = (Object.values(sizes).reduce((sum, bytes) => sum + bytes) / 1e6).toFixed(1);
const scan = new Scan(library, sizes);
let maps = null;
const cards = new Map();
/** Photographs kept from before the page was loaded, until one decides about them. */
let earlier = await kept();
/** For so long after that further photographs are of the same scan, milliseconds. */
const SAME_SCAN_MS = 3600e3;

/** One line about what goes on. */
function say(text, share = null) {
  if ($('status').textContent !== text) $('status').textContent = text;
  $('bar').hidden = share === null;
  if (share !== null) $('bar').value = share;
}

/** What can be done with the scan as it is. */
function offerActions() {
  const any = scan.photographs.length > 0;
  $('restart').hidden = !any;
  $('about').hidden = any;
  // The example would take the place of one's own photographs.
  $('example').disabled = any && !scan.description;
}

const seconds = (s) => (s >= 10 ? s.toFixed(0) : s.toFixed(1));

/* What the scan tells */

scan.addEventListener('loading', ({ detail }) => say(`Loading the library, ${(100 * detail.share).toFixed(0)} % of ${megabytes} MB`, detail.share));
scan.addEventListener('restarted', () => {
  cards.clear();
  $('photographs').replaceChildren();
  $('shots').hidden = true;
  $('fault').hidden = true;
  maps?.clear();
  offerActions();
});
scan.addEventListener('photograph', ({ detail: photograph }) => {
  const card = photographCard(photograph, scan.photographs.indexOf(photograph), (place) => maps.stage?.lookFrom(place));
  cards.get(photograph.id)?.replaceWith(card);
  if (!cards.has(photograph.id)) $('photographs').append(card);
  cards.set(photograph.id, card);
  $('shots').hidden = false;
  offerActions();
  if (!scan.description && !photograph.kept && photograph.state === 'waiting') {
    photograph.kept = true;
    keep(photograph.number, photograph.file);
  }
  if (photograph.state === 'rejected' && photograph.kept) drop(photograph.number);
  if (photograph.state === 'reading') say(`Reading ${photograph.name}`);
  if (photograph.state === 'rejected') say(`${photograph.name} cannot be used: ${photograph.row.hint}`);
});
scan.addEventListener('maps', ({ detail }) => maps.add(detail.maps, detail.photographs));
scan.addEventListener('progress', ({ detail: p }) => {
  if (p.settled) return;
  const left = p.seconds_left === null ? '' : `, ${seconds(p.seconds_left)} s left`;
  say(`Fitting ${p.photographs} photograph${p.photographs === 1 ? '' : 's'}${left}`, p.fraction);
});
scan.addEventListener('settled', ({ detail }) => maps.deviations(detail.deviations));
scan.addEventListener('idle', () => {
  const used = scan.photographs.filter((p) => p.state === 'accepted').length;
  const last = scan.photographs.at(-1);
  if (used === 0 || last?.state === 'rejected') return;
  say(`Done with ${used} photograph${used === 1 ? '' : 's'}. ${used < 5 ? 'Each further one from another side makes the maps better.' : 'Turn the light, or download the maps.'}`);
});
scan.addEventListener('fault', ({ detail }) => {
  $('fault').hidden = false;
  $('fault').textContent = detail.text;
});

/** Loads the library, once. */
async function ready() {
  try {
    const { shader, version } = await scan.ready();
    if (!maps) {
      maps = new MapsView(shader);
      $('version').textContent = `svbrdf ${version}`;
    }
    return true;
  } catch (fault) {
    scan.loading = null;
    $('fault').hidden = false;
    $('fault').textContent = `The library cannot be loaded: ${fault.message}`;
    say('');
    return false;
  }
}

const resolution = () => +document.querySelector('input[name=resolution]:checked').value;

/** Adds photographs to the scan, those of one call after those of the other. */
let added = Promise.resolve();
const add = (files) => (added = added.then(() => files.length > 0 && take(files)));

/** The first photographs begin the scan, with the chosen resolution. */
async function take(files) {
  if (!(await ready())) return;
  const before = Date.now() - (earlier.at(-1)?.at ?? 0) < SAME_SCAN_MS ? decided() : [];
  if (!scan.begun || scan.description) {
    if (before.length === 0) await clear();
    decided();
    await scan.restart(resolution());
  }
  if (before.length > 0) await scan.add(before.map((k) => k.file), before.map((k) => k.number));
  await scan.add(files);
}

/** Those of before, which are asked about no more. */
function decided() {
  const before = earlier;
  earlier = [];
  offer();
  return before;
}

function offer() {
  $('kept').hidden = earlier.length === 0;
  if (earlier.length === 0) return;
  const since = new Date(earlier.at(-1).at).toLocaleString([], { dateStyle: 'medium', timeStyle: 'short' });
  $('kept-text').textContent = `${earlier.length} photograph${earlier.length === 1 ? '' : 's'} of your last scan, ${since}, ${earlier.length === 1 ? 'is' : 'are'} still on this device.`;
}
offer();
$('kept-use').addEventListener('click', async () => {
  if (!(await ready())) return;
  const before = decided();
  await scan.restart(resolution());
  await scan.add(before.map((k) => k.file), before.map((k) => k.number));
});
$('kept-delete').addEventListener('click', () => (decided(), clear()));

/* Photographs: by button, camera, drop and clipboard */

for (const input of document.querySelectorAll('input[type=file]')) {
  input.addEventListener('change', async () => {
    const files = [...input.files];
    input.value = '';
    await add(files);
  });
}
const over = (on) => document.body.classList.toggle('over', on);
addEventListener('dragover', (event) => (event.preventDefault(), over(true)));
addEventListener('dragleave', (event) => event.relatedTarget === null && over(false));
addEventListener('drop', (event) => {
  event.preventDefault();
  over(false);
  dropped(event.dataTransfer).then(add);
});
addEventListener('paste', (event) => add([...(event.clipboardData?.files ?? [])]));

$('example').addEventListener('click', async () => {
  $('example').disabled = true;
  try {
    if (!(await ready())) return;
    const part = async (name) => {
      const answer = await fetch(`example/${name}`);
      if (!answer.ok) throw new Error(`${name}: ${answer.status}`);
      return answer;
    };
    say('Loading the example');
    const description = await (await part('capture.json')).text();
    await scan.restart(resolution(), description);
    const names = JSON.parse(description).frames.map((frame) => frame.image);
    const files = await Promise.all(names.map(async (name) => new File([await (await part(name)).blob()], name.split('/').pop())));
    await scan.add(files);
  } catch (fault) {
    $('fault').hidden = false;
    $('fault').textContent = `The example cannot be loaded: ${fault.message}`;
  } finally {
    offerActions();
  }
});
$('restart').addEventListener('click', async () => {
  decided();
  await clear();
  if (await ready()) await scan.restart(resolution());
  say('');
});
for (const choice of document.querySelectorAll('input[name=resolution]')) {
  choice.addEventListener('change', async () => {
    const again = scan.photographs.filter((p) => p.state !== 'rejected');
    if (again.length === 0) return;
    await scan.restart(resolution(), scan.description);
    await scan.add(again.map((p) => p.file), again.map((p) => p.number));
  });
}

/* Files */

function save(bytes, name, type) {
  const link = make('a', { href: URL.createObjectURL(new Blob([bytes], { type })), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}

for (const button of document.querySelectorAll('button[data-file]')) {
  button.addEventListener('click', async () => {
    const { file, paper, type } = button.dataset;
    button.disabled = true;
    try {
      if (!(await ready())) return;
      save(await scan.file(paper ? { type: 'board', paper } : { type: 'file', name: file }), file, type);
      if (paper) say('');
    } catch (fault) {
      $('fault').hidden = false;
      $('fault').textContent = `${file} cannot be made: ${fault.message}`;
    } finally {
      button.disabled = false;
    }
  });
}

/* Away and back */

document.addEventListener('visibilitychange', () => {
  if (document.hidden || scan.settled) return;
  say('Going on with the scan');
});
if ('serviceWorker' in navigator && isSecureContext) navigator.serviceWorker.register('service-worker.js').catch((fault) => console.info(`not kept for use without a network: ${fault.message}`));

/** For programs that look at the page. */
window.svbrdfPage = { scan, maps: () => maps };
