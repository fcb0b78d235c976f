'use strict';

/** Maps decoded from the pictures of the page. */
const Maps = (() => {
  const LINEAR = Float32Array.from({ length: 256 }, (_, i) => {
    const v = i / 255;
    return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  });

  async function pixels(uri) {
    const image = new Image();
    image.src = uri;
    await image.decode();
    const canvas = document.createElement('canvas');
    canvas.width = image.naturalWidth;
    canvas.height = image.naturalHeight;
    const context = canvas.getContext('2d', { willReadFrequently: true });
    context.drawImage(image, 0, 0);
    return context.getImageData(0, 0, canvas.width, canvas.height);
  }

  /** Texture data of the optional lobes from values of 8 bits; `scale`: of anisotropy, 127 steps. */
  function assembleLobes(n, scale, anisotropy, coat) {
    if (!anisotropy && !coat) return null;
    const lobes = new Float32Array(4 * n);
    for (let i = 0; i < n; i++) {
      for (let c = 0; c < 2; c++) {
        if (anisotropy) lobes[4 * i + c] = ((anisotropy(i, c) - 128) / 127) * scale;
        if (coat) lobes[4 * i + 2 + c] = coat(i, c) / 255;
      }
    }
    return lobes;
  }

  /** Texture data of the sheen: linear colour and roughness from values of 8 bits. */
  function assembleSheen(n, colour, roughness) {
    if (!colour) return null;
    const sheen = new Float32Array(4 * n);
    for (let i = 0; i < n; i++) {
      for (let c = 0; c < 3; c++) sheen[4 * i + c] = LINEAR[colour(i, c)];
      sheen[4 * i + 3] = roughness(i, 0) / 255;
    }
    return sheen;
  }

  /** Texture data from unit normals' x and y, roughness and 8-bit sRGB colours. */
  function assemble(width, height, normal, roughness, diffuse, specular) {
    const n = width * height;
    const maps = { width, height, shape: new Float32Array(4 * n) };
    for (let i = 0; i < n; i++) {
      const [x, y] = normal(i);
      const z = Math.sqrt(Math.max(1 - x * x - y * y, 1e-3));
      maps.shape[4 * i] = x / z;
      maps.shape[4 * i + 1] = y / z;
      maps.shape[4 * i + 2] = roughness(i);
      maps.shape[4 * i + 3] = 1;
    }
    for (const [name, pixel] of [['diffuse', diffuse], ['specular', specular]]) {
      const plane = (maps[name] = new Float32Array(4 * n));
      for (let i = 0; i < n; i++) {
        for (let c = 0; c < 3; c++) plane[4 * i + c] = LINEAR[pixel(i, c)];
        plane[4 * i + 3] = 1;
      }
    }
    return maps;
  }

  /** The latest maps, in full. */
  async function full(pictures) {
    const { width, height } = pictures;
    const names = ['normal', 'diffuse', 'specular', 'roughness', 'anisotropy', 'coat', 'sheen', 'sheen_roughness'];
    const [normal, diffuse, specular, roughness, anisotropy, coat, sheen, fuzz] = (
      await Promise.all(names.map((name) => pictures[name] && pixels(pictures[name])))
    ).map((picture) => picture?.data);
    const value = (data) => data && ((i, c) => data[4 * i + c]);
    const maps = assemble(
      width,
      height,
      (i) => {
        const [r, g, b] = [normal[4 * i], normal[4 * i + 1], normal[4 * i + 2]];
        return [(r * 16 + (b >> 4)) / 2047.5 - 1, (g * 16 + (b & 15)) / 2047.5 - 1];
      },
      (i) => roughness[4 * i] / 255,
      (i, c) => diffuse[4 * i + c],
      (i, c) => specular[4 * i + c],
    );
    maps.lobes = assembleLobes(width * height, pictures.scale, value(anisotropy), value(coat));
    maps.sheen = assembleSheen(width * height, value(sheen), value(fuzz));
    return maps;
  }

  /** Maps of an earlier moment: side by side in one picture. */
  async function snapshot({ width, height, scale, lobes, picture }) {
    const { data } = await pixels(picture);
    const parts = 4 + lobes.length;
    const at = (part, i) =>
      4 * (Math.floor(i / width) * parts * width + part * width + (i % width));
    const lobe = (name) => {
      const part = 4 + lobes.indexOf(name);
      return part < 4 ? undefined : (i, c) => data[at(part, i) + c];
    };
    const maps = assemble(
      width,
      height,
      (i) => [0, 1].map((c) => data[at(0, i) + c] / 127.5 - 1),
      (i) => data[at(3, i)] / 255,
      (i, c) => data[at(1, i) + c],
      (i, c) => data[at(2, i) + c],
    );
    maps.lobes = assembleLobes(width * height, scale, lobe('anisotropy'), lobe('coat'));
    maps.sheen = assembleSheen(width * height, lobe('sheen'), lobe('sheen_roughness'));
    return maps;
  }

  return { full, snapshot };
})();

/** Position at a distance, `[x, y]` being the angle off the top, degrees, in its direction. */
function onDome([x, y], distance) {
  const angle = (Math.hypot(x, y) * Math.PI) / 180;
  const azimuth = Math.atan2(y, x);
  const s = Math.sin(angle);
  return [s * Math.cos(azimuth), s * Math.sin(azimuth), Math.cos(angle)].map((v) => v * distance);
}

/** Inverse of `onDome`, whatever the distance. */
function offDome([x, y, z]) {
  const angle = (Math.atan2(Math.hypot(x, y), z) * 180) / Math.PI;
  const azimuth = Math.atan2(y, x);
  return [angle * Math.cos(azimuth), angle * Math.sin(azimuth)];
}

/** The material on a quad under one light, in WebGL 2. */
class Viewer {
  static VERTEX = `#version 300 es
    uniform vec2 halfSize; uniform mat3 turn; uniform vec3 camera; uniform vec2 scale; uniform bool flatView;
    in vec2 corner; out vec2 texel; out vec3 position;
    void main() {
      texel = vec2(0.5 + 0.5 * corner.x, 0.5 - 0.5 * corner.y);
      position = vec3(corner * halfSize, 0.0);
      vec3 seen = (position - camera) * turn;
      gl_Position = flatView ? vec4(corner, 0.0, 1.0) : vec4(seen.xy * scale, 0.0, -seen.z);
    }`;

  static TEXTURES = ['shape', 'diffuse', 'specular', 'lobes', 'sheen'];

  constructor(canvas, fragment, sampleMm) {
    const gl = canvas.getContext('webgl2', { antialias: true, alpha: true });
    if (!gl) throw new Error('no WebGL 2');
    this.canvas = canvas;
    this.gl = gl;
    this.mipmaps = gl.getExtension('EXT_color_buffer_float') || gl.getExtension('EXT_color_buffer_half_float');
    this.anisotropy = gl.getExtension('EXT_texture_filter_anisotropic');
    this.halfSize = sampleMm.map((v) => v / 2);
    this.longer = Math.max(...sampleMm);
    this.state = { camera: [0, 0, 2.5 * this.longer], light: [0, 0, 2.5 * this.longer], exposure: 1, zoom: 1, flat: false };
    this.program = this.link(Viewer.VERTEX, fragment);
    gl.useProgram(this.program);
    const corners = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, corners);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), gl.STATIC_DRAW);
    const at = gl.getAttribLocation(this.program, 'corner');
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, 2, gl.FLOAT, false, 0, 0);
    Viewer.TEXTURES.forEach((name, unit) => gl.uniform1i(this.uniform(name), unit));
  }

  link(...sources) {
    const gl = this.gl;
    const program = gl.createProgram();
    sources.forEach((source, i) => {
      const shader = gl.createShader(i ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    });
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return program;
  }

  uniform(name) {
    return this.gl.getUniformLocation(this.program, name);
  }

  /** Shows other maps. */
  load(maps) {
    const gl = this.gl;
    this.textures?.forEach((texture) => gl.deleteTexture(texture));
    this.textures = Viewer.TEXTURES.map((name, unit) => {
      // Without lobes: neither anisotropy nor a coat; without sheen: black.
      const [width, height, values] = maps[name] ? [maps.width, maps.height, maps[name]] : [1, 1, new Float32Array(4)];
      const texture = gl.createTexture();
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16F, width, height, 0, gl.RGBA, gl.FLOAT, values);
      const set = (key, value) => gl.texParameteri(gl.TEXTURE_2D, key, value);
      set(gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
      set(gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
      set(gl.TEXTURE_MAG_FILTER, gl.LINEAR);
      set(gl.TEXTURE_MIN_FILTER, this.mipmaps ? gl.LINEAR_MIPMAP_LINEAR : gl.LINEAR);
      if (this.mipmaps) gl.generateMipmap(gl.TEXTURE_2D);
      if (this.anisotropy) set(this.anisotropy.TEXTURE_MAX_ANISOTROPY_EXT, 8);
      return texture;
    });
    this.maps = maps;
    this.request();
  }

  set(state) {
    Object.assign(this.state, state);
    this.request();
  }

  request() {
    this.pending ??= requestAnimationFrame(() => {
      this.pending = null;
      this.draw();
    });
  }

  /** Draws at the size of the canvas on the screen, or one texel a pixel where `flat`. */
  draw() {
    if (!this.maps) return;
    const { gl, canvas, state } = this;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const [width, height] = state.flat
      ? [this.maps.width, this.maps.height]
      : [canvas.clientWidth, canvas.clientHeight].map((v) => Math.max(1, Math.round(v * ratio)));
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    // The camera looks at the middle and turns about a level axis only: no roll.
    const [x, y, z] = state.camera;
    const d = Math.hypot(x, y, z);
    const [a, b, c] = [x / d, y / d, z / d];
    const right = [1 - (a * a) / (1 + c), (-a * b) / (1 + c), -a];
    const up = [(-a * b) / (1 + c), 1 - (b * b) / (1 + c), -b];
    gl.uniformMatrix3fv(this.uniform('turn'), false, [...right, ...up, a, b, c]);
    gl.uniform2fv(this.uniform('halfSize'), this.halfSize);
    gl.uniform3fv(this.uniform('camera'), state.camera);
    gl.uniform3fv(this.uniform('light'), state.light);
    gl.uniform1f(this.uniform('exposure'), state.exposure);
    gl.uniform1i(this.uniform('flatView'), state.flat ? 1 : 0);
    // At zoom 1 the longer side fills 92 % of the shorter side of the canvas.
    const fill = (0.92 * 2 * d * state.zoom) / this.longer;
    const shorter = Math.min(width, height);
    gl.uniform2f(this.uniform('scale'), (fill * shorter) / width, (fill * shorter) / height);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  /** Draws at once and reads the picture back, top row first. */
  read() {
    this.draw();
    const { gl, canvas } = this;
    const { width, height } = canvas;
    const bytes = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    const rows = [];
    for (let y = height - 1; y >= 0; y--) rows.push(bytes.subarray(4 * width * y, 4 * width * (y + 1)));
    return { width, height, rows };
  }
}
