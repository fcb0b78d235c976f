/** The library in a worker: one message after the other, and the fit between them. */

/** Files of the networks. */
const NETWORKS = ['decoder.bin', 'encoder.bin', 'photo.bin', 'completion.bin'];
/** Milliseconds of the fit between two looks at the messages. */
const TURN_MS = 60;
/** Maps are shown this often at most while the fit goes on, milliseconds. */
const SHOW_MS = 400;

let library = null;
let models = null;
let memory = null;
let scan = null;
let shown = { revision: -1, at: 0 };
let turning = false;
/** Number of the scan: answers of an earlier one are out of date. */
let generation;

/** Posts what belongs to the scan. */
const tell = (message, buffers = []) => postMessage({ ...message, generation }, buffers);

/** Loads all parts, whose bytes `sizes` has, and tells how far it is. `name` is that of the library. */
async function load(name, sizes) {
  const total = Object.values(sizes).reduce((sum, bytes) => sum + bytes);
  let loaded = 0;
  const part = async (name) => {
    const answer = await fetch(name);
    if (!answer.ok) throw new Error(`${name}: ${answer.status} ${answer.statusText}`);
    const bytes = new Uint8Array(sizes[name]);
    let at = 0;
    for (const reader = answer.body.getReader(); ; ) {
      const { done, value } = await reader.read();
      if (done) break;
      if (at + value.length > bytes.length) throw new Error(`${name} is not of this version: reload the page`);
      bytes.set(value, at);
      at += value.length;
      loaded += value.length;
      postMessage({ type: 'loading', share: loaded / total });
    }
    if (at !== bytes.length) throw new Error(`${name} was cut short: reload the page`);
    const unpacked = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
    return new Uint8Array(await new Response(unpacked).arrayBuffer());
  };
  const [code, ...networks] = await Promise.all([`${name}.bin`, ...NETWORKS].map(part));
  library = await import(`./${name}.js`);
  memory = (await library.default({ module_or_path: code })).memory;
  models = new library.Models(...networks);
  postMessage({ type: 'ready', shader: library.fragment_shader(), version: library.version() });
}

/** The maps of the moment, if they are others than those shown. */
function show(settled) {
  const progress = JSON.parse(scan.progress());
  if (progress.photographs === 0) return progress;
  const due = settled || performance.now() - shown.at >= SHOW_MS;
  if (progress.maps !== shown.revision && due) {
    const [width, height] = scan.map_size();
    const maps = { width, height, sampleMm: [...scan.sample_mm()] };
    for (const name of ['shape', 'diffuse', 'specular']) maps[name] = scan.texture(name);
    const lobes = scan.lobes().split('\n').filter(Boolean);
    if (lobes.length) maps.lobes = scan.texture('lobes');
    if (lobes.includes('sheen')) maps.sheen = scan.texture('sheen');
    for (const name of ['normal', 'diffuse', 'specular', 'roughness', ...lobes]) maps[`${name}Picture`] = scan.picture(name);
    const buffers = Object.values(maps).filter((v) => ArrayBuffer.isView(v)).map((v) => v.buffer);
    tell({ type: 'maps', maps, photographs: progress.photographs }, buffers);
    shown = { revision: progress.maps, at: performance.now() };
  }
  return progress;
}

/** Goes on with the fit until it has settled. */
function turn() {
  turning = false;
  if (!scan) return;
  guarded(() => {
    const more = scan.go_on(TURN_MS);
    const progress = show(!more);
    const settled = !more && progress.settled;
    tell({ type: 'progress', progress, bytes: memory.buffer.byteLength });
    if (settled) tell({ type: 'settled', deviations: JSON.parse(scan.deviations()), places: JSON.parse(scan.places()) });
    else if (more) start();
  });
}

function start() {
  if (turning) return;
  turning = true;
  setTimeout(turn, 0);
}

const actions = {
  load: ({ library, sizes }) => load(library, sizes),
  begin({ number, resolution, description }) {
    generation = number;
    scan?.free();
    scan = null;
    shown = { revision: -1, at: 0 };
    scan = new library.Scan(models, resolution, description);
    models.prepare(resolution);
  },
  push({ id, name, bytes, announced }) {
    scan.announce(announced);
    const row = JSON.parse(scan.push(name, new Uint8Array(bytes)));
    const small = scan.small();
    const accepted = row.status === 'accepted';
    const places = accepted ? JSON.parse(scan.places()) : null;
    tell({ type: 'pushed', id, row, small, places, bytes: memory.buffer.byteLength }, [small.buffer]);
    if (accepted) show(true), start();
  },
  file({ id, name }) {
    const bytes = name === 'report.json' ? new TextEncoder().encode(scan.report()) : scan.file(name);
    postMessage({ type: 'file', id, bytes }, [bytes.buffer]);
  },
  board({ id, paper }) {
    const bytes = library.board(paper);
    postMessage({ type: 'file', id, bytes }, [bytes.buffer]);
  },
};

/** Why the library ended. Without a word of its own, an allocation has failed. */
function lastWords() {
  try {
    return library.last_panic() ?? 'memory';
  } catch {
    return 'memory';
  }
}

/** A fault of one call leaves the scan as it is; after a trap the library is lost. */
async function guarded(action, id) {
  try {
    await action();
  } catch (fault) {
    const lost = fault instanceof WebAssembly.RuntimeError || fault instanceof RangeError;
    const text = lost ? lastWords() : String(fault.message ?? fault);
    postMessage({ type: 'fault', id, lost, text });
  }
}

addEventListener('message', ({ data }) => guarded(() => actions[data.type](data), data.id));
