/**
 * Photographs of the scan, kept by the browser until it is started over: phones end pages in the
 * background, as this one is while the camera app is open. Where a browser keeps nothing, as in
 * private windows, the page works all the same.
 */

const STORE = 'photographs';

const opened = () => new Promise((resolve, reject) => {
  const asked = indexedDB.open('svbrdf', 1);
  asked.onupgradeneeded = () => asked.result.createObjectStore(STORE);
  asked.onsuccess = () => resolve(asked.result);
  asked.onerror = () => reject(asked.error);
});

/** What `action` asks of the store, once it is written; `otherwise` where that fails. */
async function stored(mode, action, otherwise) {
  try {
    const base = await opened();
    try {
      return await new Promise((resolve, reject) => {
        const transaction = base.transaction(STORE, mode);
        const asked = action(transaction.objectStore(STORE));
        transaction.oncomplete = () => resolve(asked.result);
        transaction.onabort = () => reject(transaction.error);
      });
    } finally {
      base.close();
    }
  } catch (fault) {
    console.info(`photographs are not kept: ${fault?.message}`);
    return otherwise;
  }
}

/** Keeps a file under a number; files are given back in the order of these. */
export const keep = (number, file) => stored('readwrite', (store) => store.put({ number, file, at: Date.now() }, number));
/** Keeps that file no more. */
export const drop = (number) => stored('readwrite', (store) => store.delete(number));
/** Keeps nothing more. */
export const clear = () => stored('readwrite', (store) => store.clear());
/** What is kept: `number` and `file`, and since when, `at`, in milliseconds since 1970. */
export const kept = () => stored('readonly', (store) => store.getAll(), []);
