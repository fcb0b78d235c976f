/** A scan as the page sees it: photographs wait their turn, and outlive the worker. */

/** Photographs of a scan; each has a file, a state and what was said of it. */
export class Scan extends EventTarget {
  /** `library`: its name, `relaxed` or `simd128`. `sizes`: bytes of its file and of those of the networks. */
  constructor(library, sizes) {
    super();
    Object.assign(this, { library, sizes });
    this.photographs = [];
    this.answers = new Map();
    this.next = 0;
    this.resolution = 256;
    this.description = null;
    this.begun = false;
    this.settled = true;
    this.number = 0;
  }

  tell(type, detail = {}) {
    this.dispatchEvent(new CustomEvent(type, { detail }));
  }

  /** Starts the worker, once; resolves when the library can be used. */
  ready() {
    this.loading ??= new Promise((resolve, reject) => {
      this.worker = new Worker(new URL('worker.js', import.meta.url), { type: 'module' });
      this.worker.addEventListener('message', ({ data }) => {
        // What an earlier scan had still to say.
        if (data.generation !== undefined && data.generation !== this.number) return;
        if (data.type === 'ready') resolve(data);
        if (data.type === 'fault' && data.id === undefined && !this.begun) reject(new Error(data.text));
        this[`on_${data.type}`]?.(data);
      });
      this.worker.addEventListener('error', (event) => {
        event.preventDefault();
        reject(new Error(event.message || 'the worker cannot be started'));
      });
      this.worker.postMessage({ type: 'load', library: this.library, sizes: this.sizes });
    });
    return this.loading;
  }

  /** Forgets everything; `description` is that of a capture, if there is one. */
  async restart(resolution, description = null) {
    Object.assign(this, { photographs: [], resolution, description, begun: false, settled: true, pushing: null });
    this.number++;
    this.tell('restarted');
    await this.begin();
  }

  async begin() {
    await this.ready();
    this.begun = true;
    this.settled = true;
    const { number } = this;
    this.worker.postMessage({ type: 'begin', number, resolution: this.resolution, description: this.description ?? undefined });
  }

  /** Adds files; each is taken in when the fit has settled on those before. `numbers` of files that are kept already. */
  async add(files, numbers = []) {
    const photographs = [...files].map((file, i) => {
      const id = this.next++;
      return { id, number: numbers[i] ?? 1000 * Date.now() + id, kept: i in numbers, file, name: file.name, state: 'waiting' };
    });
    this.photographs.push(...photographs);
    photographs.forEach((photograph) => this.tell('photograph', photograph));
    if (!this.begun) await this.begin();
    this.go();
  }

  /** Hands over the next photograph that waits. */
  async go() {
    if (this.pushing || !this.settled || !this.begun) return;
    const photograph = this.photographs.find((p) => p.state === 'waiting');
    if (!photograph) return this.tell('idle');
    this.pushing = photograph;
    photograph.state = 'reading';
    this.tell('photograph', photograph);
    try {
      const bytes = await photograph.file.arrayBuffer();
      if (this.pushing !== photograph) return;
      // With this one.
      const announced = 1 + this.photographs.filter((p) => p.state === 'waiting').length;
      this.worker.postMessage({ type: 'push', id: photograph.id, name: photograph.name, bytes, announced }, [bytes]);
    } catch (fault) {
      this.refuse(photograph, `the file cannot be read: ${fault.message}`);
    }
  }

  refuse(photograph, hint) {
    Object.assign(photograph, { state: 'rejected', row: { hint, hints: [] } });
    this.pushing = null;
    this.tell('photograph', photograph);
    this.go();
  }

  /** A file of the maps, as bytes. */
  async file(message) {
    await this.ready();
    const id = `file${this.next++}`;
    return new Promise((resolve, reject) => {
      this.answers.set(id, { resolve, reject });
      this.worker.postMessage({ ...message, id });
    });
  }

  on_loading({ share }) {
    this.tell('loading', { share });
  }

  on_pushed({ id, row, small, places, bytes }) {
    const photograph = this.pushing;
    if (photograph?.id !== id) return;
    this.pushing = null;
    this.bytes = bytes;
    photograph.state = row.status;
    photograph.row = row;
    if (row.small) photograph.small = { width: row.small[0], height: row.small[1], rgba: small };
    this.tell('photograph', photograph);
    if (places) this.placed(places);
    if (row.status === 'accepted') this.settled = false;
    else this.go();
  }

  /** Poses of all accepted photographs are known better with each one. */
  placed(places) {
    const accepted = this.photographs.filter((p) => p.state === 'accepted');
    accepted.forEach((photograph, i) => {
      photograph.place = places[i];
      this.tell('photograph', photograph);
    });
  }

  on_maps({ maps, photographs }) {
    this.tell('maps', { maps, photographs });
  }

  on_progress({ progress, bytes }) {
    this.bytes = bytes;
    this.tell('progress', progress);
  }

  on_settled({ deviations, places }) {
    this.settled = true;
    this.placed(places);
    this.tell('settled', { deviations });
    this.go();
  }

  on_file({ id, bytes }) {
    this.answers.get(id)?.resolve(bytes);
    this.answers.delete(id);
  }

  on_fault({ id, lost, text }) {
    const why = text === 'memory' ? 'it needs more memory than the browser gives this page; a smaller picture may do' : text;
    if (this.answers.has(id)) {
      this.answers.get(id).reject(new Error(why));
      this.answers.delete(id);
    }
    if (lost) return this.recover(why);
    if (this.pushing?.id === id && id !== undefined) this.refuse(this.pushing, why);
    else this.tell('fault', { text: why });
  }

  /** Begins anew with the photographs that were in the scan; what broke it is left out. */
  async recover(why) {
    this.worker.terminate();
    this.answers.forEach(({ reject }) => reject(new Error(why)));
    this.answers.clear();
    Object.assign(this, { loading: null, begun: false, settled: true });
    const broken = this.pushing ?? this.photographs.findLast((p) => p.state === 'accepted');
    this.pushing = null;
    for (const photograph of this.photographs.filter((p) => p.state === 'accepted')) photograph.state = 'waiting';
    if (broken) Object.assign(broken, { state: 'rejected', row: { hint: why, hints: [] } });
    this.tell('fault', { text: `The scan began anew without ${broken?.name ?? 'the last step'}: ${why}.` });
    this.photographs.forEach((photograph) => this.tell('photograph', photograph));
    await this.begin();
    this.go();
  }
}
