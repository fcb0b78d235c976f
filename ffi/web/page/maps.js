/** The maps side by side, under a light, and after each number of photographs. */

const KINDS = [['normal', 'Normal'], ['diffuse', 'Diffuse albedo'], ['specular', 'Specular albedo (F0)'], ['roughness', 'Roughness']];
/** Only materials that show these lobes have their maps. */
const LOBES = [['anisotropy', 'Anisotropy'], ['coat', 'Coat'], ['sheen', 'Sheen'], ['sheen_roughness', 'Sheen roughness']];
const LIGHTINGS = [
  { label: 'From above', light: [18, 24], view: [0, 0], exposure: 1 },
  { label: 'Raking', light: [-76, 10], view: [0, 0], exposure: 2.2 },
  { label: 'Towards the light', light: [0, 48], view: [0, -48], exposure: 0.7 },
  { label: 'As photographed', light: [2, 3], view: [0, 0], exposure: 1 },
];

/** Shows maps; remembers the latest of each number of photographs. */
export class MapsView {
  constructor(shader) {
    this.shader = shader;
    this.moments = new Map();
    this.cells = [...KINDS, ...LOBES].map(([name, title]) => {
      const canvas = make('canvas', { role: 'img', 'aria-label': `${title} map`, id: `map-${name}` });
      const deviation = make('span', { class: 'quiet' });
      return { name, canvas, deviation, figure: make('figure', {}, make('div', { class: 'frame' }, canvas), make('figcaption', {}, title, deviation)) };
    });
    $('maps').append(...this.cells.map((cell) => cell.figure));
    $('moment').addEventListener('input', () => this.choose(+$('moment').value));
  }

  clear() {
    this.moments.clear();
    this.chosen = null;
    this.deviations(null);
    $('result').hidden = true;
  }

  /** Maps have come. */
  add(maps, photographs) {
    const following = this.chosen === null || this.chosen === undefined || this.chosen >= this.moments.size;
    this.moments.set(photographs, maps);
    for (const [name] of LOBES) document.querySelector(`[data-file="${name}.png"]`).hidden = !maps[`${name}Picture`];
    if ($('result').hidden) {
      $('result').hidden = false;
      this.light(maps);
    }
    $('timeline').hidden = this.moments.size < 2;
    $('moment').min = 1;
    $('moment').max = this.moments.size;
    if (following) this.choose(this.moments.size);
  }

  light(maps) {
    if (this.stage || this.still) return;
    const mm = 2.5 * Math.max(...maps.sampleMm);
    const presets = LIGHTINGS.map(({ label, light, view, exposure }) =>
      ({ label, light_mm: onDome(light, mm), camera_mm: onDome(view, mm), exposure }));
    $('presets').append(...presets.map(({ label }, i) =>
      make('button', { type: 'button', 'aria-pressed': 'false', click: () => this.stage.preset(i) }, make('span', {}, label))));
    try {
      this.stage = new Stage(new Viewer($('quad'), this.shader, maps.sampleMm), presets);
      this.stage.light = LIGHTINGS[0].light;
      this.stage.update();
    } catch (fault) {
      this.still = true;
      $('material').hidden = true;
      console.info(`no viewer: ${fault.message}`);
    }
  }

  /** Shows the maps after so many photographs. */
  choose(photographs) {
    const maps = this.moments.get(photographs);
    if (!maps) return;
    this.chosen = photographs;
    $('moment').value = photographs;
    const text = `${photographs} photograph${photographs === 1 ? '' : 's'}`;
    $('moment').setAttribute('aria-valuetext', `after ${text}`);
    $('moment-text').textContent = text;
    if (this.stage) {
      this.stage.viewer.halfSize = maps.sampleMm.map((v) => v / 2);
      this.stage.viewer.longer = Math.max(...maps.sampleMm);
      this.stage.viewer.load(maps);
    }
    for (const { name, canvas, figure } of this.cells) {
      const picture = maps[`${name}Picture`];
      figure.hidden = !picture;
      if (!picture) continue;
      [canvas.width, canvas.height] = [maps.width, maps.height];
      const rgba = new Uint8ClampedArray(picture);
      canvas.getContext('2d').putImageData(new ImageData(rgba, maps.width, maps.height), 0, 0);
    }
  }

  /** How far the maps may be off. */
  deviations(of) {
    const said = of && {
      normal: `± ${((Math.atan(of.normal) * 180) / Math.PI).toFixed(1)}°`,
      diffuse: `± ${of.diffuse.toFixed(3)}`,
      specular: `± ${of.specular.toFixed(3)}`,
      roughness: `± ${of.roughness.toFixed(2)}`,
      anisotropy: of.anisotropy && `± ${of.anisotropy.toFixed(2)} of ln(alpha ratio)`,
      coat: of.coat && `± ${of.coat.toFixed(2)}, its roughness ± ${of.coat_roughness.toFixed(2)}`,
      sheen: of.sheen && `± ${of.sheen.toFixed(3)}`,
      sheen_roughness: of.sheen_roughness && `± ${of.sheen_roughness.toFixed(2)}`,
    };
    this.cells.forEach(({ name, deviation }) => (deviation.textContent = said?.[name] ?? ''));
    $('stated').hidden = !of;
  }
}
