/** Keeps the page for use without a network: all files of one version, or none. */

importScripts('library.js');
const NAME = 'svbrdf-{{version}}';
const OTHER = svbrdfLibrary === 'relaxed' ? 'simd128' : 'relaxed';
const FILES = {{files}}.filter((name) => !name.startsWith(`./${OTHER}.`));

addEventListener('install', (event) => event.waitUntil((async () => {
  await (await caches.open(NAME)).addAll(FILES);
  await skipWaiting();
})()));

addEventListener('activate', (event) => event.waitUntil((async () => {
  const names = await caches.keys();
  await Promise.all(names.filter((name) => name.startsWith('svbrdf-') && name !== NAME).map((name) => caches.delete(name)));
  await clients.claim();
})()));

addEventListener('fetch', (event) => {
  if (event.request.method !== 'GET') return;
  event.respondWith((async () => (await caches.match(event.request, { ignoreSearch: true })) ?? fetch(event.request))());
});
