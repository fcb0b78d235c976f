/** Makes an element; attributes that are functions listen. */
function make(tag, attributes = {}, ...children) {
  const svg = attributes.svg || /^(svg|g|circle|line|polyline|polygon|text)$/.test(tag);
  const element = svg ? document.createElementNS('http://www.w3.org/2000/svg', tag) : document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (key === 'svg' || value === undefined || value === null || value === false) continue;
    if (typeof value === 'function') element.addEventListener(key, value);
    else element.setAttribute(key, value === true ? '' : value);
  }
  element.append(...children.flat(Infinity).filter((child) => child || child === 0 || child === ''));
  return element;
}

/** Round steps that cover 0 to `top` in three to five. */
function ticks(top) {
  const raw = top / 4;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 2.5, 5, 10].map((m) => m * power).find((s) => s >= raw);
  return Array.from({ length: Math.ceil(top / step - 1e-9) + 1 }, (_, i) => i * step);
}

const digits = (v) => (v >= 1 ? v.toFixed(2) : v.toFixed(4)).replace(/^0\./, '.');

/**
 * A line over numbers of photographs: `points` are [photographs, value], `before` likewise (hollow),
 * `each` thin lines. A table says the same to those who cannot see it.
 */
function lineChart({ title, note, points, before = [], each = [], tone }) {
  const [width, height, left, right, top, bottom] = [420, 230, 46, 16, 16, 34];
  const all = [...points, ...before, ...each.flat()];
  const xs = points.map((p) => p[0]);
  const [first, last] = [Math.min(...xs), Math.max(...xs)];
  const scale = ticks(Math.max(...all.map((p) => p[1])) * 1.05 || 1);
  const x = (v) => left + (last > first ? (v - first) / (last - first) : 0.5) * (width - left - right);
  const y = (v) => height - bottom - (v / scale[scale.length - 1]) * (height - top - bottom);
  const path = (list) => list.map(([px, py]) => `${x(px).toFixed(1)},${y(py).toFixed(1)}`).join(' ');
  const label = (v, i) => i === points.length - 1 || i === 0 || points.length <= 9 ? String(v) : '';
  const [endX, endY] = points[points.length - 1];
  return make('figure', { class: 'plot' },
    make('figcaption', {}, title, make('span', { class: 'quiet' }, ` ${note}`)),
    make('svg', { viewBox: `0 0 ${width} ${height}`, 'aria-hidden': 'true' },
      scale.map((v) => [
        make('line', { class: 'grid', x1: left, x2: width - right, y1: y(v), y2: y(v) }),
        make('text', { x: left - 7, y: y(v) + 4, 'text-anchor': 'end' }, v === 0 ? '0' : String(+v.toPrecision(3)).replace(/^0\./, '.')),
      ]),
      xs.map((v, i) => make('text', { x: x(v), y: height - bottom + 18, 'text-anchor': 'middle' }, label(v, i))),
      make('text', { x: width - right, y: height - 2, 'text-anchor': 'end' }, 'photographs in the fit'),
      each.map((list) => make('polyline', { class: `thin tone-${tone}`, points: path(list) })),
      before.map(([px, py], i) => make('line', { class: `thin tone-${tone}`, x1: x(px), x2: x(px), y1: y(py), y2: y(points[i][1]) })),
      make('polyline', { class: `line tone-${tone}`, points: path(points) }),
      before.map(([px, py]) => make('circle', { class: `open tone-${tone}`, cx: x(px), cy: y(py), r: 3.5 },
        make('title', { svg: true }, `before photograph ${px} was fitted: ${digits(py)}`))),
      points.map(([px, py]) => make('circle', { class: `dot fill-${tone}`, cx: x(px), cy: y(py), r: 5 },
        make('title', { svg: true }, `after ${px}: ${digits(py)}`))),
      make('text', { class: 'value', x: x(endX), y: y(endY) - 11, 'text-anchor': points.length > 1 ? 'end' : 'middle' }, digits(endY)),
    ),
    make('table', { class: 'hidden' },
      make('caption', {}, title),
      points.map(([px, py]) => make('tr', {}, make('th', { scope: 'row' }, `after ${px}`), make('td', {}, digits(py)))),
    ),
  );
}

/** Cameras as seen from above: the middle is the top, rings are 15° apart. */
function viewsChart(photographs, next) {
  const reach = Math.max(45, ...photographs.map((p) => p.view.off_top_deg + 4), next ? next.tilt_deg + 4 : 0);
  const radius = 104;
  const place = (angle, azimuth) => {
    const r = (radius * angle) / reach;
    const a = (azimuth * Math.PI) / 180;
    return [r * Math.cos(a), -r * Math.sin(a)];
  };
  const rings = [15, 30, 45, 60, 75].filter((v) => v <= reach);
  const mark = (p) => {
    const [cx, cy] = place(p.view.off_top_deg, p.view.azimuth_deg);
    return make('g', {},
      make('circle', { class: p.held_out ? 'camera held' : 'camera', cx, cy, r: 9.5 },
        make('title', { svg: true }, `photo ${p.index + 1}: ${p.view.off_top_deg.toFixed(0)}° off the vertical, ${p.view.distance_mm.toFixed(0)} mm away`)),
      make('text', { class: 'mark', x: cx, y: cy + 0.5 }, String(p.index + 1)));
  };
  const there = next ? place(next.tilt_deg, next.azimuth_deg) : null;
  const advice = next
    ? `next best: ${next.tilt_deg.toFixed(0)}° off the vertical${next.tilt_deg > 1 ? `, towards ${compass(next.azimuth_deg)}` : ''}`
    : 'seen from above, rings 15° apart';
  return make('figure', { class: 'plot' },
    make('figcaption', {}, 'Where the photographs were taken', make('span', { class: 'quiet' }, ` ${advice}`)),
    make('svg', { viewBox: '-165 -116 330 232', role: 'img', 'aria-label': `Camera positions of ${photographs.length} photographs. ${advice}.` },
      rings.map((v) => [
        make('circle', { class: 'grid', r: (radius * v) / reach }),
        make('text', { x: (radius * v) / reach * 0.5 + 3, y: (radius * v) / reach * 0.866 + 10 }, `${v}°`),
      ]),
      make('line', { class: 'grid', x1: -radius, x2: radius, y1: 0, y2: 0 }), make('line', { class: 'grid', y1: -radius, y2: radius, x1: 0, x2: 0 }),
      there && [make('circle', { class: 'next', cx: there[0], cy: there[1], r: 12 }), make('text', { x: there[0] + 16, y: there[1] + 4 }, 'next')],
      photographs.map(mark)),
  );
}

/** Side of the sample in words, from degrees counter-clockwise from its right. */
function compass(azimuth) {
  const sides = ['right', 'top right', 'top', 'top left', 'left', 'bottom left', 'bottom', 'bottom right'];
  return `the ${sides[Math.round(azimuth / 45) % 8]}`;
}
