/** Files that were dropped on the page, folders looked into. */

const PICTURES = /\.(jpe?g|png|tiff?|exr|dng|hei[cf])$/i;

const asFile = (entry) => new Promise((resolve, reject) => entry.file(resolve, reject));

/** Pictures in a folder, by name; other files are left alone. */
async function inside(folder) {
  const reader = folder.createReader();
  const entries = [];
  // Browsers hand out a part at a time.
  for (;;) {
    const part = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (part.length === 0) break;
    entries.push(...part);
  }
  entries.sort((a, b) => a.name.localeCompare(b.name, undefined, { numeric: true }));
  const found = entries.map((entry) => (entry.isDirectory ? inside(entry) : PICTURES.test(entry.name) ? [asFile(entry)] : []));
  return Promise.all((await Promise.all(found)).flat());
}

/** The files of a drop. To be called while its event is handled: later the browser has forgotten them. */
export async function dropped(transfer) {
  const entries = [...(transfer.items ?? [])].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  if (!entries.some((entry) => entry.isDirectory)) return [...transfer.files];
  return (await Promise.all(entries.map((entry) => (entry.isDirectory ? inside(entry) : asFile(entry))))).flat();
}
