/**
 * Which library this browser runs, for the page and its service worker: `relaxed` has fused multiply-add, by the
 * relaxed vector instructions; `simd128` is for browsers that do not know them.
 */

// A function with `f32x4.relaxed_madd`.
globalThis.svbrdfLibrary = WebAssembly.validate(Uint8Array.of(
  0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 19, 1, 17, 0,
  65, 1, 253, 15, 65, 1, 253, 15, 65, 1, 253, 15, 253, 133, 2, 11,
)) ? 'relaxed' : 'simd128';
