// One row per axis: its value, its last seconds, what the high-pass leaves, and the histogram of that.

import { fixed, node, roundUp, write } from "./frame.js";

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// Fewer decimals for a newton than for a newton metre, which is about a hundred times as much here.
const decimals = (unit) => (unit === "N" ? 3 : 4);

function surface(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  return { pen, width, height };
}

function extremes(values) {
  let low = Infinity, high = -Infinity;
  for (const value of values) {
    if (!Number.isFinite(value)) continue;
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return low <= high ? [low, high] : null;
}

// Ends on round numbers, so that the scale does not tremble with the noise.
function limits(values, least) {
  const found = extremes(values);
  if (!found) return null;
  const step = roundUp(Math.max(found[1] - found[0], least)) / 10;
  return [Math.floor(found[0] / step) * step, Math.ceil(found[1] / step) * step];
}

function symmetric(values, least) {
  const found = extremes(values);
  if (!found) return null;
  const end = roundUp(Math.max(-found[0], found[1], least));
  return [-end, end];
}

const label = (x) => (Math.abs(x) < 1e7 ? Number(x.toPrecision(3)).toString() : x.toPrecision(3)).replace("-", "\u2212");

function drawTrace(canvas, ages, values, [low, high], span, ink) {
  const { pen, width, height } = surface(canvas);
  const y = (value) => 2 + (height - 4) * (1 - (value - low) / (high - low));
  pen.strokeStyle = colour("--line");
  pen.lineWidth = 1;
  pen.beginPath();
  for (const level of low < 0 && high > 0 ? [low, 0, high] : [low, high]) {
    pen.moveTo(0, Math.round(y(level)) + 0.5);
    pen.lineTo(width, Math.round(y(level)) + 0.5);
  }
  pen.stroke();
  pen.strokeStyle = ink;
  pen.lineWidth = 1.5;
  pen.lineJoin = "round";
  pen.beginPath();
  let drawing = false;
  for (let i = 0; i < ages.length; i += 1) {
    if (Number.isNaN(values[i])) { drawing = false; continue; }  // instants that never came are a gap
    const x = width * (1 - ages[i] / span);
    if (drawing) pen.lineTo(x, y(values[i]));
    else pen.moveTo(x, y(values[i]));
    drawing = true;
  }
  pen.stroke();
}

// The part with counts, at least ten bins on either side of the middle.
function drawBins(canvas, counts, [low, high], ink) {
  const { pen, width, height } = surface(canvas);
  const n = counts.length, middle = n / 2;
  let reach = Math.min(middle, 10);
  let most = 0;
  counts.forEach((count, i) => {
    if (count) reach = Math.max(reach, Math.ceil(Math.abs(i + 0.5 - middle)));
    most = Math.max(most, count);
  });
  const first = Math.max(0, Math.floor(middle - reach)), last = Math.min(n, Math.ceil(middle + reach));
  const bar = width / (last - first);
  pen.fillStyle = ink;
  for (let i = first; i < last; i += 1) {
    if (!counts[i]) continue;
    // The root, so that the few large values that tell materials apart are not lost beside the many small ones.
    const tall = Math.max(1.5, (height - 16) * Math.sqrt(counts[i] / most));
    pen.fillRect((i - first) * bar + 0.5, height - tall - 1, Math.max(bar - 1, 1), tall);
  }
  pen.fillStyle = colour("--line");
  pen.fillRect(0, height - 1, width, 1);
  const edge = (i) => low + (high - low) * (i / n);
  return [edge(first), edge(last), most];
}

function figure(kind, about, spans) {
  const canvas = node("canvas", { role: "img", "aria-label": about });
  const caption = node("figcaption");
  const places = spans.map((name) => node("span", { class: name }));
  return { canvas, caption, places, box: node("figure", { class: kind }, caption, canvas, ...places) };
}

export class Axes {
  constructor(place) {
    this.place = place;
    this.rows = [];
  }

  make(names) {
    this.names = names.join();
    this.rows = names.map((axis, i) => {
      const value = node("data", { class: "value" });
      const unit = node("span", { class: "unit" });
      const name = node("span", { class: "name" });
      const [, kind, letter] = /^([ft])([xyz])$/.exec(axis) ?? [];
      if (kind) name.append(kind.toUpperCase(), node("sub", {}, letter));
      else name.append(axis);
      const trace = figure("trace", `${axis}, last seconds`, ["high", "low"]);
      const residual = figure("residual", `${axis}, high-passed`, ["high", "low"]);
      const bins = figure("bins", `${axis}, histogram of the high-passed signal`, ["low", "most", "high"]);
      const head = node("h3", {}, name, node("span", {}, value, " ", unit));
      const row = node("div", { class: "axis" }, head, trace.box, residual.box, bins.box);
      row.dataset.axis = axis;
      row.style.setProperty("--mark", `var(--okabe-${i % 6})`);
      return { value, unit, trace, residual, bins };
    });
    this.place.replaceChildren(...this.rows.map((row) => row.value.closest(".axis")));
  }

  values(frame) {
    if (this.names !== frame.axes.join()) this.make(frame.axes);
    this.rows.forEach((row, i) => {
      const value = frame.latest[i], unit = frame.units[i];
      row.value.setAttribute("value", value ?? "");
      write(row.value, value === null ? "\u2013" : fixed(value, decimals(unit)).replace("-", "\u2212"));
      write(row.unit, unit.replace(" ", "\u00a0"));
    });
  }

  draw(frame) {
    if (this.names !== frame.axes.join()) this.make(frame.axes);
    const span = Math.max(frame.age_s[0] ?? 0, 5);
    this.rows.forEach((row, i) => {
      const ink = colour(`--okabe-${i % 6}`);
      const least = frame.units[i] === "N" ? 0.05 : 0.002;
      const captions = [`last ${span.toFixed(0)} s`, `above ${frame.cutoff_hz} Hz`, "histogram since start"];
      for (const [k, part] of [row.trace, row.residual, row.bins].entries()) write(part.caption, captions[k]);
      for (const [part, values, range] of [
        [row.trace, frame.wrench[i], limits(frame.wrench[i], least)],
        [row.residual, frame.residual[i], symmetric(frame.residual[i], least)],
      ]) {
        drawTrace(part.canvas, frame.age_s, values, range ?? [-1, 1], span, ink);
        write(part.places[0], range ? label(range[1]) : "");
        write(part.places[1], range ? label(range[0]) : "");
      }
      const [first, last, most] = drawBins(row.bins.canvas, frame.counts[i], frame.bins[i], ink);
      write(row.bins.places[0], label(first));
      write(row.bins.places[1], most ? `${most.toLocaleString("en")} max` : "");
      write(row.bins.places[2], `${label(last)} ${frame.units[i]}`);
    });
    write(document.getElementById("head-wrench"), `last ${span.toFixed(0)} s`);
    write(document.getElementById("head-residual"), `the same above ${frame.cutoff_hz} Hz`);
  }
}
