// What the server sends, made ready for drawing.

function floats(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const view = new DataView(bytes.buffer);  // the order of bytes is that of the format, not of this machine
  return Float32Array.from({ length: bytes.length / 4 }, (_, i) => view.getFloat32(4 * i, true));
}

function rows(text, n) {
  const all = floats(text);
  const length = n ? all.length / n : 0;
  return Array.from({ length: n }, (_, i) => all.subarray(i * length, (i + 1) * length));
}

export function read(text) {
  const sent = JSON.parse(text);
  const n = sent.axes.length;
  return {
    ...sent,
    age_s: floats(sent.age_s),
    wrench: rows(sent.wrench, n),
    residual: rows(sent.residual, n),
    counts: rows(sent.counts, n),
    history_s: floats(sent.history_s),
    history_losses: rows(sent.history_losses, sent.classes.length),
  };
}

// A number of the series 1, 2, 5, 10, ... that is not smaller.
export function roundUp(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  return [1, 2, 5, 10].map((f) => f * power).find((f) => f >= x * (1 - 1e-9));
}

// So many decimals, but no row of digits that nothing has room for.
export function fixed(x, decimals) {
  return Math.abs(x) < 1e7 ? x.toFixed(decimals) : x.toPrecision(3);
}

export function node(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

// Text that has not changed is not written again: screen readers and selections stay where they are.
export function write(place, text) {
  if (place.textContent !== text) place.textContent = text;
}
