const $ = (id) => document.getElementById(id);

/** One decimal with a true minus sign; no sign for 0. */
function signed(v) {
  const text = Math.abs(v).toFixed(1);
  return text === '0.0' ? text : `${v > 0 ? '+' : '−'}${text}`;
}

/** Everything that moves light and view: dragging, keys, sliders, lightings. */
class Stage {
  constructor(viewer, presets) {
    this.viewer = viewer;
    this.presets = presets;
    this.distance = 2.5 * viewer.longer;
    this.light = [0, 0];
    this.view = [0, 0];
    this.stops = 0;
    this.zoom = 0;
    this.sliders();
    this.dragging($('quad'), (dx, dy, asView) => {
      const gain = 110 / Math.min($('quad').clientWidth, $('quad').clientHeight);
      if (asView) this.move('view', this.view[0] - gain * dx, this.view[1] + gain * dy);
      else this.move('light', this.light[0] + gain * dx, this.light[1] - gain * dy);
    });
    this.dome();
    $('quad').addEventListener('keydown', (event) => this.key(event));
    new ResizeObserver(() => viewer.request()).observe($('quad'));
    matchMedia('(prefers-reduced-motion: reduce)').matches || this.intro();
  }

  /** Moves light or view to an angle, held where something is to be seen. */
  move(what, x, y, byHand = true) {
    const most = what === 'light' ? 85 : 75;
    const angle = Math.hypot(x, y);
    const scale = angle > most ? most / angle : 1;
    this[what] = [x * scale, y * scale];
    if (byHand) this.touched();
    this.update();
  }

  touched() {
    this.still = true;
    $('hint').classList.add('gone');
    document.querySelectorAll('#presets button').forEach((b) => b.setAttribute('aria-pressed', 'false'));
  }

  update() {
    this.viewer.set({
      light: onDome(this.light, this.distance),
      camera: onDome(this.view, this.distance),
      exposure: 2 ** this.stops,
      zoom: 2 ** this.zoom,
    });
    const side = ([x, y]) => ((Math.atan2(y, x) * 180) / Math.PI + 360) % 360;
    const show = (id, value, text) => {
      $(id).value = value;
      $(id).setAttribute('aria-valuetext', text);
      document.querySelector(`output[for="${id}"]`).textContent = text;
    };
    for (const what of ['light', 'view']) {
      const angle = Math.hypot(...this[what]);
      show(`${what}-angle`, angle, `${angle.toFixed(0)}°`);
      // Straight above there is no side: the slider stays.
      if (angle > 0.01) this[`${what}Side`] = side(this[what]);
      const turned = this[`${what}Side`] ?? 0;
      show(`${what}-side`, turned, compass(turned).replace('the ', ''));
    }
    show('exposure', this.stops, `${signed(this.stops)} EV`);
    show('zoom', this.zoom, `${(2 ** this.zoom).toFixed(1)}×`);
    const at = ([x, y]) => `translate(${(x / 90) * 46} ${(-y / 90) * 46})`;
    document.querySelector('#dome .sun').setAttribute('transform', at(this.light));
    document.querySelector('#dome .eye').setAttribute('transform', at(this.view));
  }

  sliders() {
    for (const what of ['light', 'view']) {
      const turn = () => {
        const angle = Math.max(+$(`${what}-angle`).value, 0.02);
        const a = (+$(`${what}-side`).value * Math.PI) / 180;
        this.move(what, angle * Math.cos(a), angle * Math.sin(a));
      };
      $(`${what}-angle`).addEventListener('input', turn);
      $(`${what}-side`).addEventListener('input', turn);
    }
    $('exposure').addEventListener('input', () => ((this.stops = +$('exposure').value), this.touched(), this.update()));
    $('zoom').addEventListener('input', () => ((this.zoom = +$('zoom').value), this.update()));
  }

  dragging(target, moved) {
    let last = null;
    target.addEventListener('pointerdown', (event) => {
      target.setPointerCapture(event.pointerId);
      last = [event.clientX, event.clientY];
      this.touched();
    });
    target.addEventListener('pointermove', (event) => {
      if (!last) return;
      const view = document.querySelector('input[name=drag]:checked').value === 'view';
      moved(event.clientX - last[0], event.clientY - last[1], view !== (event.shiftKey || event.buttons === 2));
      last = [event.clientX, event.clientY];
    });
    for (const end of ['pointerup', 'pointercancel']) target.addEventListener(end, () => (last = null));
    target.addEventListener('contextmenu', (event) => event.preventDefault());
  }

  /** The small dome: the light goes where one points. */
  dome() {
    const place = (event) => {
      const box = $('dome').getBoundingClientRect();
      const unit = 90 / ((box.width * 46) / 100);
      this.move('light', (event.clientX - box.left - box.width / 2) * unit, (box.top + box.height / 2 - event.clientY) * unit);
    };
    $('dome').addEventListener('pointerdown', (event) => ($('dome').setPointerCapture(event.pointerId), place(event)));
    $('dome').addEventListener('pointermove', (event) => event.buttons && place(event));
  }

  key(event) {
    const step = { ArrowLeft: [-4, 0], ArrowRight: [4, 0], ArrowUp: [0, 4], ArrowDown: [0, -4] }[event.key];
    if (step) {
      const what = event.shiftKey ? 'view' : 'light';
      this.move(what, this[what][0] + step[0], this[what][1] + step[1]);
    } else if (event.key === '+' || event.key === '=') this.zoom = Math.min(3, this.zoom + 0.25);
    else if (event.key === '-') this.zoom = Math.max(0, this.zoom - 0.25);
    else if (event.key === '0') this.preset(0);
    else return;
    event.preventDefault();
    this.update();
  }

  /** One of the page's lightings. */
  preset(index) {
    const { camera_mm, light_mm, exposure } = this.presets[index];
    this.touched();
    [this.light, this.view, this.stops, this.zoom] = [offDome(light_mm), offDome(camera_mm), Math.log2(exposure), 0];
    document.querySelectorAll('#presets button')[index].setAttribute('aria-pressed', 'true');
    this.update();
  }

  /** As a photograph was taken, the light at the camera. */
  lookFrom(view) {
    const a = (view.azimuth_deg * Math.PI) / 180;
    const at = [view.off_top_deg * Math.cos(a), view.off_top_deg * Math.sin(a)];
    this.move('view', ...at);
    this.move('light', ...at);
    $('material').scrollIntoView({ block: 'start' });
    $('quad').focus({ preventScroll: true });
  }

  /** One turn of the light, once, to show that it can be moved. */
  intro() {
    const [start, from, seconds] = [performance.now(), offDome(this.presets[0].light_mm), 4.5];
    const turn = (now) => {
      const t = (now - start) / 1000 / seconds;
      if (this.still) return;
      if (t >= 1) return this.move('light', ...from, false);
      const a = 2 * Math.PI * (t * t * (3 - 2 * t));
      const r = 26 * Math.sin(Math.PI * t);
      this.move('light', from[0] + r * Math.cos(a), from[1] + r * Math.sin(a), false);
      requestAnimationFrame(turn);
    };
    requestAnimationFrame(turn);
  }
}
