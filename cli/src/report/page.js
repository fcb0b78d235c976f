const data = JSON.parse(document.getElementById('data').textContent);

/* Texts */

$('name').textContent = data.name;
$('summary').append(...data.summary.map((fact) => make('li', {}, fact)));
$('footer').textContent = `svbrdf ${data.version}. This page holds all that it shows and loads nothing.`;
if (data.warnings.length) {
  $('notes').hidden = false;
  $('warnings').append(...data.warnings.map((w) => make('li', {}, make('strong', {}, w.title), w.text)));
}
$('figures').append(
  ...data.figures.map((group) =>
    make('div', {}, make('h3', {}, group.title),
      make('dl', {}, group.rows.flatMap(([name, value]) => [make('dt', {}, name), make('dd', {}, value)])))),
);

/* Photographs */

const plural = (n, one) => `${n} ${one}${n === 1 ? '' : 's'}`;

function photograph(p) {
  const held = p.held_out === true;
  const rejected = p.status === 'rejected';
  const verdict = rejected ? ['rejected', '✕ rejected'] : held ? ['held', '◇ held out'] : ['fitted', '✓ fitted'];
  const facts = [];
  if (p.view) facts.push(['Off the top', `${p.view.off_top_deg.toFixed(0)}°`], ['Distance', `${p.view.distance_mm.toFixed(0)} mm`]);
  if (typeof p.reprojection_rms_px === 'number') facts.push(['Corners', `${p.reprojection_rms_px.toFixed(2)} px`]);
  if (typeof p.loss_after === 'number') facts.push(['Residual', `${digits(p.loss_before)} → ${digits(p.loss_after)}`]);
  if (typeof p.held_out_error === 'number') facts.push(['Error, unseen', digits(p.held_out_error)]);
  if (typeof p.seconds === 'number') facts.push(['Time', `${p.seconds.toFixed(1)} s`]);
  const sentence = (text) => `${text[0].toUpperCase()}${text.slice(1)}${/[.?!]$/.test(text) ? '' : '.'}`;
  const said = [...(rejected ? [p.hint] : []), ...(p.hints ?? []).map((h) => h.hint)].filter(Boolean);
  const outline = (name, points) => {
    const list = points?.map((xy) => xy.map((v) => (1000 * v).toFixed(1)).join(',')).join(' ');
    return list && [make('polygon', { class: 'edge', points: list }), make('polygon', { class: name, points: list })];
  };
  const t = p.thumbnail;
  return make('article', { class: `photograph${rejected ? ' is-rejected' : ''}`, 'aria-label': `Photo ${p.index + 1}` },
    make('div', { class: 'picture' },
      t && make('img', { src: t.picture, alt: `Photo ${p.index + 1}, ${p.name}`, style: `aspect-ratio: ${t.width} / ${t.height}` }),
      t && p.outlines && make('svg', { viewBox: '0 0 1000 1000', preserveAspectRatio: 'none', 'aria-hidden': 'true' },
        outline('board', p.outlines.board), outline('sample', p.outlines.sample))),
    make('div', { class: 'text' },
      make('h3', {}, `${p.index + 1} · ${p.name}`, make('span', { class: `verdict ${verdict[0]}` }, verdict[1])),
      said.map((text) => make('p', {}, sentence(text))),
      make('dl', {}, facts.flatMap(([name, value]) => [make('dt', {}, name), make('dd', {}, value)])),
      p.view && stage && make('button', { type: 'button', click: () => stage.lookFrom(p.view) }, 'Relight from here')));
}

/* The material and its lights */

/** Without WebGL 2: pictures. */
function stills() {
  $('quad').hidden = true;
  $('dome').style.display = 'none';
  document.querySelectorAll('.drag, .sliders, #keys').forEach((element) => (element.hidden = true));
  $('hint').textContent = 'Pictures, since this browser has no WebGL 2';
  $('still').hidden = false;
  const show = (index) => {
    $('still').src = data.presets[index].picture;
    $('still').alt = `The material: ${data.presets[index].label}`;
    document.querySelectorAll('#presets button').forEach((b, i) => b.setAttribute('aria-pressed', String(i === index)));
  };
  return { preset: show };
}

let stage = null;
const lightings = data.presets.map((preset, index) =>
  make('button', { type: 'button', 'aria-pressed': 'false', click: () => (stage ?? pictures).preset(index) },
    make('img', { src: preset.picture, alt: '' }), make('span', {}, preset.label)));
$('presets').append(...lightings);

let pictures = null;
try {
  stage = new Stage(new Viewer($('quad'), $('fragment').textContent, data.sample_mm), data.presets);
  [stage.light, stage.view, stage.stops] = [offDome(data.presets[0].light_mm), [0, 0], Math.log2(data.presets[0].exposure)];
  stage.update();
} catch (fault) {
  console.info(`no viewer: ${fault.message}`);
  pictures = stills();
  pictures.preset(0);
}

/* Maps side by side */

const encode = (v) => 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
const triple = (plane, i) => [0, 1, 2].map((c) => plane[4 * i + c].toFixed(3)).join(', ');
/** Ratio of both alphas, and the angle of the direction of the larger one. */
const stretch = (m, i) => {
  const [u, v] = m.lobes ? [m.lobes[4 * i], m.lobes[4 * i + 1]] : [0, 0];
  return [Math.exp(Math.hypot(u, v)), 0.5 * Math.atan2(v, u)];
};
/** Weight and roughness of the coat. */
const coat = (m, i) => (m.lobes ? [m.lobes[4 * i + 2], m.lobes[4 * i + 3]] : [0, 0]);
const KINDS = [
  ['Normal', (m, i) => {
    const [p, q] = [m.shape[4 * i], m.shape[4 * i + 1]];
    const z = 1 / Math.hypot(p, q, 1);
    return [127.5 * (p * z + 1), 127.5 * (q * z + 1), 127.5 * (z + 1)];
  }, (m, i) => {
    const [p, q] = [m.shape[4 * i], m.shape[4 * i + 1]];
    return `${((Math.atan(Math.hypot(p, q)) * 180) / Math.PI).toFixed(1)}° off the vertical`;
  }],
  ['Diffuse albedo', (m, i) => [0, 1, 2].map((c) => encode(m.diffuse[4 * i + c])), (m, i) => triple(m.diffuse, i)],
  ['Specular albedo (F0)', (m, i) => [0, 1, 2].map((c) => encode(m.specular[4 * i + c])), (m, i) => triple(m.specular, i)],
  ['Roughness', (m, i) => Array(3).fill(255 * m.shape[4 * i + 2]), (m, i) => m.shape[4 * i + 2].toFixed(2)],
  // Direction and strength as in anisotropy.png.
  data.maps.anisotropy && ['Anisotropy', (m, i) => {
    const [ratio, angle] = stretch(m, i);
    const [alpha, root] = [m.shape[4 * i + 2] ** 2, Math.sqrt(ratio)];
    const strength = Math.sqrt(Math.max(0, Math.min(1, alpha * root) - alpha / root) / Math.max(1 - alpha / root, 1e-6));
    return [127.5 * (Math.cos(angle) + 1), 127.5 * (Math.sin(angle) + 1), 255 * strength];
  }, (m, i) => {
    const [ratio, angle] = stretch(m, i);
    return ratio < 1.05 ? 'none' : `${ratio.toFixed(1)} : 1, wider along ${((angle * 180) / Math.PI).toFixed(0)}°`;
  }],
  data.maps.coat && ['Coat', (m, i) => Array(3).fill(255 * coat(m, i)[0]), (m, i) => {
    const [weight, roughness] = coat(m, i);
    return weight > 0 ? `weight ${weight.toFixed(2)}, roughness ${roughness.toFixed(2)}` : 'none';
  }],
  data.maps.sheen && ['Sheen', (m, i) => [0, 1, 2].map((c) => (m.sheen ? encode(m.sheen[4 * i + c]) : 0)), (m, i) => (
    m.sheen?.slice(4 * i, 4 * i + 3).some((v) => v > 0) ? `${triple(m.sheen, i)}, roughness ${m.sheen[4 * i + 3].toFixed(2)}` : 'none'
  )],
].filter(Boolean);

const MapsView = {
  point: null,
  cells: KINDS.map(([title], k) => {
    const canvas = make('canvas', { tabindex: '0', role: 'img', 'aria-label': `${title} map` });
    const point = make('span', { class: 'point', hidden: true });
    const value = make('span', { class: 'quiet' });
    canvas.addEventListener('pointermove', (event) => {
      const box = canvas.getBoundingClientRect();
      MapsView.show((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    });
    canvas.addEventListener('keydown', (event) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!step) return;
      event.preventDefault();
      const [x, y] = MapsView.point ?? [0.5, 0.5];
      MapsView.show(x + step[0] / 64, y + step[1] / 64);
    });
    return { canvas, point, value, figure: make('figure', {}, make('div', { class: 'frame' }, canvas, point), make('figcaption', {}, title, value)) };
  }),

  load(maps) {
    this.maps = maps;
    this.cells.forEach(({ canvas }, k) => {
      [canvas.width, canvas.height] = [maps.width, maps.height];
      const context = canvas.getContext('2d');
      const picture = context.createImageData(maps.width, maps.height);
      for (let i = 0; i < maps.width * maps.height; i++) {
        const rgb = KINDS[k][1](maps, i);
        for (let c = 0; c < 3; c++) picture.data[4 * i + c] = rgb[c] + 0.5;
        picture.data[4 * i + 3] = 255;
      }
      context.putImageData(picture, 0, 0);
    });
    if (this.point) this.show(...this.point);
  },

  show(x, y) {
    this.point = [x, y].map((v) => Math.min(Math.max(v, 0), 0.9999));
    const { width, height } = this.maps;
    const [column, row] = [Math.floor(this.point[0] * width), Math.floor(this.point[1] * height)];
    this.cells.forEach(({ point, value }, k) => {
      point.hidden = false;
      [point.style.left, point.style.top] = this.point.map((v) => `${100 * v}%`);
      value.textContent = KINDS[k][2](this.maps, row * width + column);
    });
    const [mmX, mmY] = [(this.point[0] - 0.5) * data.sample_mm[0], (0.5 - this.point[1]) * data.sample_mm[1]];
    $('probe').textContent = `At ${mmX.toFixed(1)}, ${mmY.toFixed(1)} mm from the middle.`;
  },
};
$('maps').append(...MapsView.cells.map((cell) => cell.figure));

/* Earlier moments */

const moments = [...data.snapshots.map((s) => () => Maps.snapshot(s)), () => Maps.full(data.maps)];
const fitted = data.photographs.filter((p) => p.status === 'accepted' && !p.held_out).length;
let wanted = -1;

async function showMoment(index) {
  wanted = index;
  const count = data.snapshots[index]?.photographs ?? fitted;
  const text = index === moments.length - 1 ? `all ${plural(count, 'photograph')}` : plural(count, 'photograph');
  $('moment').value = index;
  $('moment').setAttribute('aria-valuetext', `after ${text}`);
  $('moment-text').textContent = count === 1 ? '1 photograph' : text;
  const maps = await (moments[index].made ??= moments[index]());
  if (wanted !== index) return;
  stage?.viewer.load(maps);
  MapsView.load(maps);
}

if (moments.length > 1) {
  $('timeline').hidden = false;
  $('moment').max = moments.length - 1;
  $('moment').addEventListener('input', () => showMoment(+$('moment').value));
  let timer = null;
  const stop = () => (clearInterval(timer), (timer = null), ($('play').textContent = 'Play'));
  $('play').addEventListener('click', () => {
    if (timer) return stop();
    $('play').textContent = 'Stop';
    showMoment(0);
    timer = setInterval(() => (wanted < moments.length - 1 ? showMoment(wanted + 1) : stop()), 900);
  });
}
const ready = showMoment(moments.length - 1);

/* Photographs, curves */

$('photographs').append(...data.photographs.map(photograph));
if (data.photographs.some((p) => p.outlines)) {
  $('photographs').before(make('p', { class: 'quiet legend' },
    make('i', { style: 'color: var(--board)' }), 'board as found', make('i', { style: 'color: var(--sample)' }), 'sample'));
}
const placed = data.photographs.filter((p) => p.view);
const settled = data.photographs.filter((p) => typeof p.loss_after === 'number');
if (settled.length) {
  $('charts').append(lineChart({
    title: 'Residual', note: 'mean difference of logarithms, all photographs so far; hollow: before the fit', tone: 'a',
    points: settled.map((p, i) => [i + 1, p.loss_after]),
    before: settled.map((p, i) => [i + 1, p.loss_before]),
  }));
}
if (data.held_out?.length && data.held_out[0].each.length) {
  $('charts').append(lineChart({
    title: 'Error on photographs held out', note: 'root mean square, gamma 2.2', tone: 'b',
    points: data.held_out.map((a) => [a.fitted, a.error]),
    each: data.held_out[0].each.length > 1 ? data.held_out[0].each.map((_, j) => data.held_out.map((a) => [a.fitted, a.each[j]])) : [],
  }));
}
if (placed.length) $('charts').append(viewsChart(placed, data.next_view));
if (data.predictions.length) {
  $('held-out').hidden = false;
  $('predictions').append(...data.predictions.map((p) =>
    make('figure', {},
      make('div', { class: 'three' }, ['the photograph', 'its prediction', 'the difference'].map((what) =>
        make('img', { src: p.picture, alt: `Photo ${p.index + 1}: ${what}` }))),
      make('figcaption', {}, `Photo ${p.index + 1}: error ${digits(p.error)}, ΔE00 ${p.delta_e.toFixed(1)}, brightness ×${p.brightness.toFixed(2)}`))));
}

/** For programs that look at the page. */
window.svbrdfReport = { data, stage, ready, showMoment };
