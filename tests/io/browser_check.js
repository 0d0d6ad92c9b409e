// What the checks of all pages share. A check is a script with a function usePage(), which uses the page as a person does
// and returns what it sees. REFERENCES: pictures to compare with, PNG files as data; null where none are wanted.
const frame = () => new Promise(done => requestAnimationFrame(() => setTimeout(done, 0)));
const text = id => document.getElementById(id).textContent;
const hex = bytes => [...bytes].map(byte => byte.toString(16).padStart(2, "0")).join("");

// How many controls a screen reader has no name for.
const unnamed = () => [...document.querySelectorAll("button, select, input, canvas")].filter(e =>
  !e.getAttribute("aria-label") && !e.closest("label") && !e.textContent.trim()).length;

const pixelsOf = (source, width, height) => {
  const canvas = document.createElement("canvas"), pen = canvas.getContext("2d");
  canvas.width = width; canvas.height = height;
  pen.drawImage(source, 0, 0);
  return pen.getImageData(0, 0, width, height).data;
};
// The share of a canvas's pixels that plainly differ from the reference: by more than 20 of 255 in a colour. Soft edges
// and the rounding of another browser stay below that, or are few.
async function difference(canvas, name) {
  if (!REFERENCES[name]) return 1;
  const image = new Image();
  // Not image.decode(): the clock of the browser, which has a limit, does not wait for that.
  await new Promise((done, fail) => { image.onload = done; image.onerror = fail; image.src = REFERENCES[name]; });
  const {width, height} = canvas;
  if (image.width !== width || image.height !== height) return 1;
  const a = pixelsOf(canvas, width, height), b = pixelsOf(image, width, height);
  let count = 0;
  for (let k = 0; k < a.length; k += 4)
    if (Math.max(Math.abs(a[k] - b[k]), Math.abs(a[k + 1] - b[k + 1]), Math.abs(a[k + 2] - b[k + 2])) > 20) ++count;
  return count / (width * height);
}
// A size that depends on neither fonts nor window.
const pin = (canvas, width, height) =>
  { canvas.style.cssText = `width: ${width}px; height: ${height}px; max-height: none; aspect-ratio: auto`; };
async function notePicture(seen, canvas, name) {
  const apart = await difference(canvas, name), url = canvas.toDataURL("image/png");
  (seen.pictures ??= []).push(`${name} ${apart.toFixed(5)} ${hex(Uint8Array.from(atob(url.split(",")[1]), c => c.charCodeAt(0)))}`);
}
// What must be told from the reference, lest the comparison sees nothing.
async function noteWrong(seen, canvas, name, what) { (seen.wrong ??= []).push(`${name} ${(await difference(canvas, name)).toFixed(5)} ${what}`); }
