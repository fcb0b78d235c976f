/** Photographs with what was said of them. */

const VERDICTS = {
  waiting: ['held', '… waiting'],
  reading: ['held', '… reading'],
  accepted: ['fitted', '✓ used'],
  rejected: ['rejected', '✕ not used'],
};

const sentence = (text) => `${text[0].toUpperCase()}${text.slice(1)}${/[.?!]$/.test(text) ? '' : '.'}`;

function picture(small, name) {
  const canvas = make('canvas', { role: 'img', 'aria-label': name });
  [canvas.width, canvas.height] = [small.width, small.height];
  const rgba = new Uint8ClampedArray(small.rgba);
  canvas.getContext('2d').putImageData(new ImageData(rgba, small.width, small.height), 0, 0);
  return canvas;
}

function outline(name, points) {
  const list = points?.map((xy) => xy.map((v) => (1000 * v).toFixed(1)).join(',')).join(' ');
  return list && [make('polygon', { class: 'edge', points: list }), make('polygon', { class: name, points: list })];
}

/** A photograph's card; `look` turns the viewer to where it was taken from. */
export function photographCard(photograph, index, look) {
  const { name, state, row, small, place } = photograph;
  const [tone, verdict] = VERDICTS[state];
  const said = [state === 'rejected' && row.hint, ...(row?.hints ?? []).map((h) => h.hint)].filter(Boolean);
  const facts = [];
  if (place) facts.push(['Off the top', `${place.off_top_deg.toFixed(0)}°`], ['Distance', `${place.distance_mm.toFixed(0)} mm`]);
  if (typeof row?.reprojection_rms_px === 'number') facts.push(['Corners', `${row.reprojection_rms_px.toFixed(2)} px`]);
  return make('article', { class: `photograph${state === 'rejected' ? ' is-rejected' : ''}`, 'aria-label': `Photograph ${index + 1}` },
    make('div', { class: 'picture' }, small && picture(small, name),
      place && make('svg', { viewBox: '0 0 1000 1000', preserveAspectRatio: 'none', 'aria-hidden': 'true' },
        outline('board', place.board), outline('sample', place.sample))),
    make('div', { class: 'text' },
      make('h3', {}, `${index + 1} · ${name}`, make('span', { class: `verdict ${tone}` }, verdict)),
      said.map((text) => make('p', {}, sentence(text))),
      facts.length > 0 && make('dl', {}, facts.flatMap(([key, value]) => [make('dt', {}, key), make('dd', {}, value)])),
      place && make('button', { type: 'button', click: () => look(place) }, 'Relight from here')));
}
