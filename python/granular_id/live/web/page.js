// Draws what the server sends, as fast as this browser can, but no faster than an eye can read. All words come from there.

const WORDS_MS = 160;  // numbers that change faster cannot be read
const SPEECH_MS = 1500;  // a screen reader must be able to end its sentence
const LONG = 26;  // letters; more are set smaller
const SILENCE_MS = 4000;  // the server says something every second: after this the line is dead
const calm = window.matchMedia("(prefers-reduced-motion: reduce)");

const $ = (id) => document.getElementById(id);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const minus = (text) => text.replace("-", "\u2212");
const tick = (x, decimals) => (Math.abs(x) < 1e7 ? x.toFixed(decimals) : x.toPrecision(3));

function node(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

// Text that has not changed is not written again: screen readers and selections stay where they are.
function write(place, text) {
  if (place.textContent !== text) place.textContent = text;
}

// What the server sends.

function floats(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const view = new DataView(bytes.buffer);  // the order of bytes is that of the format, not of this machine
  return Float32Array.from({ length: bytes.length / 4 }, (_, i) => view.getFloat32(4 * i, true));
}

function rows(text, n) {
  const all = floats(text), length = n ? all.length / n : 0;
  return Array.from({ length: n }, (_, i) => all.subarray(i * length, (i + 1) * length));
}

function read(text) {
  const sent = JSON.parse(text), n = sent.axes.length;
  for (const name of ["age_s", "history_s"]) sent[name] = floats(sent[name]);
  for (const name of ["wrench", "residual", "counts"]) sent[name] = rows(sent[name], n);
  sent.history_losses = rows(sent.history_losses, sent.classes.length);
  return sent;
}

// Words: the answer, the health of the stream, warnings, the history, and what a screen reader says.

let spoken = { number: 0, at: 0, state: "" };

function figures(list) {
  const place = $("figures"), names = list.map(([name]) => name).join();
  if (place.dataset.names !== names) {
    place.dataset.names = names;
    place.replaceChildren(...list.map(([name]) => node("div", {}, node("dt", {}, name), node("dd"))));
  }
  list.forEach(([, value, alarm], i) => {
    place.children[i].classList.toggle("alarm", alarm);
    write(place.children[i].lastChild, value);
  });
}

function warnings(list) {
  const place = $("warnings"), text = list.join("\n");
  place.hidden = !list.length;
  if (place.dataset.text === text) return;
  place.dataset.text = text;
  place.replaceChildren(...list.map((one) => node("li", {}, one)));
}

function history(list) {
  const place = $("history"), newest = list[0]?.number ?? 0;
  if (Number(place.dataset.newest ?? 0) === newest) return;
  place.dataset.newest = newest;
  write($("history-note"), `The newest is on top${newest > list.length ? `; the last ${list.length} of ${newest}` : ""}.`);
  place.replaceChildren(...list.map((one) => node("li", { value: one.number, "data-kind": one.kind },
    node("span", { class: "when" }, node("b", {}, one.number), " ", node("time", {}, one.clock)),
    node("bdi", { class: "name" }, one.title),
    node("span", { class: "more" }, one.detail),
    ...one.warnings.map((text) => node("span", { class: "warned" }, text)))));
}

// What came of a push is spoken as it comes; states as slowly as a sentence takes; provisional answers never.
function speak(frame, now) {
  const number = frame.history[0]?.number ?? 0;
  if (number !== spoken.number) {
    write($("spoken"), frame.spoken);
    spoken = { number, at: now, state: "" };
  } else if (frame.state !== spoken.state && now - spoken.at >= SPEECH_MS && !frame.complete) {
    write($("spoken"), frame.state);
    spoken = { number, at: now, state: frame.state };
  }
}

function tell(frame, now) {
  const { kind, title, stage, detail } = frame.answer, provisional = kind === "provisional";
  $("top").dataset.kind = kind;
  $("title").classList.toggle("long", title.length > LONG);
  $("synthetic").hidden = !frame.synthetic;
  const source = `granular_id live \u00b7 ${frame.source}`;
  const all = { title, stage, detail, source, state: frame.state, score: frame.score, synthetic: frame.synthetic };
  for (const [id, text] of Object.entries(all)) write($(id), text);
  document.title = `${frame.synthetic ? "SYNTHETIC: " : ""}${title}${provisional ? " so far" : ""} \u00b7 granular_id live`;
  const seen = frame.history_s.at(-1) ?? 0;
  $("progress").style.transform = `scaleX(${provisional ? Math.min(1, seen / frame.capture_s) : Number(frame.complete)})`;
  figures(frame.figures);
  warnings(frame.warnings);
  history(frame.history);
  speak(frame, now);
  document.body.dataset.number = frame.number;
}

// Loss of every material while the signal grows, named at the end of its line.

const LINE = 17;  // pixels between two names
const TOP = 12, BOTTOM = 26, LEFT = 40;
const fits = new Map();

function drawn(name, attributes, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

const chart = drawn("svg", { role: "img", "aria-label": "Mean loss of each material over time; the list after it says the same" });
$("ranking").append(chart);

// Names of a series differ at their ends: what is too long loses its middle.
function short(letters, most) {
  if (letters.length <= most) return letters.join("");
  const tail = Math.floor((most - 1) / 2);
  return `${letters.slice(0, most - 1 - tail).join("")}\u2026${tail ? letters.slice(-tail).join("") : ""}`;
}

// Letters of one script are twice as wide as those of another: measured, and once only.
function fitted(name, kind, room) {
  const key = `${kind} ${room} ${name}`;
  if (!fits.has(key)) {
    if (fits.size > 5000) fits.clear();
    const letters = Array.from(new Intl.Segmenter().segment(name), (part) => part.segment);
    const probe = chart.appendChild(drawn("text", { class: kind }));
    let most = letters.length;
    do probe.textContent = short(letters, most);
    while (probe.getComputedTextLength() > room && (most -= 1) > 1);
    fits.set(key, probe.textContent);
    probe.remove();
  }
  return fits.get(key);
}

// Names keep their order and a line's distance, and stay as near to their lines as that allows.
function spread(wanted, low, high) {
  const places = [...wanted];
  places.forEach((place, i) => { places[i] = Math.max(place, i ? places[i - 1] + LINE : low); });
  for (let i = places.length - 1, below = high; i >= 0; i -= 1, below = places[i + 1] - LINE) places[i] = Math.min(places[i], below);
  return places;
}

function rankingList({ ranking: list, history_s: times }) {
  const place = $("ranking-list"), texts = times.length ? list.map((pair) => pair.join(", ")) : [];
  if (place.children.length !== texts.length) place.replaceChildren(...texts.map(() => node("li")));
  texts.forEach((text, i) => write(place.children[i], text));
}

function ranking(frame) {
  const { classes, history_s: times, history_losses: losses } = frame, n = times.length;
  const width = Math.max($("ranking").clientWidth, 260);
  const wide = window.matchMedia("(min-width: 64.01rem)").matches;
  const height = Math.max(wide ? $("axes").offsetHeight / 2 : 260, TOP + BOTTOM + LINE * (classes.length + 1));
  chart.setAttribute("viewBox", `0 0 ${width} ${height}`);
  chart.style.height = `${height}px`;
  if (!n) {
    const words = classes.length ? "The lines begin with the next capture." : "There is no model: nothing to rank.";
    chart.replaceChildren(drawn("text", { x: 0, y: 24, class: "empty" }, words));
    return;
  }
  const gutter = Math.min(190, width * 0.45), right = width - gutter, bottom = height - BOTTOM;
  const until = Math.max(frame.capture_s, times[n - 1]);
  const [low, high] = extremes(losses.flatMap((line) => [...line])) ?? [0, 1];
  const span = Math.max(high - low, 1e-6);
  const x = (s) => LEFT + (right - LEFT) * (s / until);
  const y = (loss) => TOP + (bottom - TOP) * Math.min(1, (loss - low) / span);  // the smallest loss on top
  const parts = [];
  for (const level of [low, low + span / 2, low + span]) {
    parts.push(drawn("line", { x1: LEFT, x2: right, y1: y(level), y2: y(level) }));
    parts.push(drawn("text", { x: LEFT - 6, y: y(level) + 4, "text-anchor": "end", class: "tick" }, tick(level, 2)));
  }
  const step = until > 60 ? 30 : until > 20 ? 10 : until > 6 ? 2 : until > 1.5 ? 1 : 0.2;
  for (let s = 0; s <= until * 1.0001; s += step) {
    const told = frame.ago ? s - until : s;  // where answers go on, how long ago
    const words = `${minus(Number(told.toFixed(1)).toString())}${s + step > until * 1.0001 ? " s" : ""}`;
    parts.push(drawn("text", { x: x(s), y: height - 8, "text-anchor": "middle", class: "tick" }, words));
  }
  const order = classes.map((name, k) => ({ name, line: losses[k], end: losses[k][n - 1] })).sort((a, b) => a.end - b.end);
  const ends = order.map(({ end }) => y(end)), places = spread(ends, TOP, bottom), at = x(times[n - 1]);
  order.map(({ name, line, end }, rank) => {
    const kind = ["first", "second"][rank] ?? "other", below = places[rank] + 4.5, loss = tick(end, 3);
    const points = Array.from(times, (s, i) => `${x(s).toFixed(1)},${y(line[i]).toFixed(1)}`).join(" ");
    const tie = `${at},${ends[rank]} ${right},${ends[rank]} ${right + 10},${places[rank]}`;
    const room = Math.round(gutter - 24 - 9 * loss.length);
    return [
      drawn("polyline", { class: "tie", points: tie }),
      drawn("polyline", { class: kind, points }),
      drawn("text", { class: kind, x: right + 14, y: below }, fitted(name, kind, room)),
      drawn("text", { class: kind, x: width, y: below, "text-anchor": "end" }, loss),
    ];
  }).reverse().forEach((four) => parts.push(...four));  // the best is drawn last, on top
  chart.replaceChildren(...parts);
}

// One row per axis: its value, its last seconds, what the high-pass leaves, and the histogram of that.

let axisRows = [];

function figure(kind, about, spans) {
  const canvas = node("canvas", { role: "img", "aria-label": about });
  const caption = node("figcaption"), places = spans.map((name) => node("span", { class: name }));
  return { canvas, caption, places, box: node("figure", { class: kind }, caption, canvas, ...places) };
}

function makeAxes({ axes, units }) {
  axisRows = axes.map((axis, i) => {
    const value = node("span", { class: "value" });
    const parts = /^[ft][xyz]$/.test(axis) ? [axis[0].toUpperCase(), node("sub", {}, axis[1])] : [axis];
    const name = node("span", { class: "name" }, ...parts);
    const trace = figure("trace", `${axis}, last seconds`, ["high", "low"]);
    const residual = figure("residual", `${axis}, high-passed`, ["high", "low"]);
    const bins = figure("bins", `${axis}, histogram of the high-passed signal`, ["low", "most", "high"]);
    const unit = node("span", { class: "unit" }, units[i].replace(" ", "\u00a0"));
    const head = node("h3", {}, name, node("span", {}, value, " ", unit));
    const box = node("div", { class: "axis", "data-axis": axis }, head, trace.box, residual.box, bins.box);
    box.style.setProperty("--mark", `var(--okabe-${i % 6})`);
    return { value, trace, residual, bins, box };
  });
  $("axes").replaceChildren(...axisRows.map((row) => row.box));
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

// A number of the series 1, 2, 5, 10, ... that is not smaller.
function roundUp(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  return [1, 2, 5, 10].map((f) => f * power).find((f) => f >= x * (1 - 1e-9));
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

const label = (x) => minus(Math.abs(x) < 1e7 ? Number(x.toPrecision(3)).toString() : x.toPrecision(3));

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

function drawTrace({ canvas, places }, ages, values, range, span, ink) {
  const [low, high] = range ?? [-1, 1];
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
  write(places[0], range ? label(high) : "");
  write(places[1], range ? label(low) : "");
}

// The part with counts, at least ten bins on either side of the middle.
function drawBins({ canvas, places }, counts, [low, high], unit, ink) {
  const { pen, width, height } = surface(canvas);
  const n = counts.length, middle = n / 2;
  let reach = Math.min(middle, 10), most = 0;
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
  write(places[0], label(edge(first)));
  write(places[1], most ? `${most.toLocaleString("en")} max` : "");
  write(places[2], `${label(edge(last))} ${unit}`);
}

function signals(frame) {
  const span = Math.max(frame.age_s[0] ?? 0, 5), seconds = `last ${span.toFixed(0)} s`;
  const counted = frame.ago ? "its histogram" : "histogram since start";
  write($("head-wrench"), seconds);
  write($("head-bins"), counted);
  write($("head-residual"), `the same above ${frame.cutoff_hz} Hz`);
  axisRows.forEach(({ trace, residual, bins }, i) => {
    const ink = colour(`--okabe-${i % 6}`), unit = frame.units[i], least = unit === "N" ? 0.05 : 0.002;
    write(trace.caption, seconds);
    write(residual.caption, `above ${frame.cutoff_hz} Hz`);
    write(bins.caption, counted);
    drawTrace(trace, frame.age_s, frame.wrench[i], limits(frame.wrench[i], least), span, ink);
    drawTrace(residual, frame.age_s, frame.residual[i], symmetric(frame.residual[i], least), span, ink);
    drawBins(bins, frame.counts[i], frame.bins[i], unit, ink);
  });
}

// When to show it.

let newest = null, frame = null, scheduled = false, paused = false;
let words = 0, drawings = 0;

function show() {
  scheduled = false;
  const now = performance.now();
  if (newest !== null) {
    frame = read(newest);
    newest = null;
  }
  if (frame === null) return;
  if (!axisRows.length) makeAxes(frame);
  let later = 0;
  const isAnother = frame.answer.kind !== $("top").dataset.kind;  // drawings do not run ahead of the words
  if (isAnother || now - words >= WORDS_MS) {
    words = now;
    tell(frame, now);
    if (!paused) {
      axisRows.forEach((row, i) => write(row.value, minus(frame.values[i])));
      rankingList(frame);
    }
  } else later = WORDS_MS - (now - words);
  if (!paused && !document.hidden) {
    const rest = (calm.matches ? 500 : 0) - (now - drawings);
    if (rest <= 0) {
      drawings = now;
      signals(frame);
      ranking(frame);
    } else later = Math.max(later, rest);
  }
  if (later) setTimeout(schedule, later);
}

// A hidden page gets no animation frames: it keeps its title and its voice, once a second.
function schedule() {
  if (scheduled) return;
  scheduled = true;
  if (document.hidden) setTimeout(show, 1000);
  else requestAnimationFrame(show);
}

// The line to the server.

let heard = 0, stream = null, ended = false;

function link(state, text) {
  if (document.body.dataset.link !== state) document.body.dataset.link = state;
  $("trouble").hidden = !text;
  write($("trouble"), text);
}

function lost() {
  if (ended) return;
  write($("quiet"), "");
  link("lost", "The connection to the session is lost. Trying again \u2026 what is shown is old.");
}

function connect() {
  stream?.close();
  stream = new EventSource("events");
  const on = (kind, then) => stream.addEventListener(kind, (message) => {
    heard = performance.now();
    link("open", "");
    write($("quiet"), "");
    then(message);
  });
  on("open", () => {});
  on("snapshot", (message) => {
    newest = message.data;
    schedule();
  });
  on("quiet", (message) => {
    link("quiet", "");
    write($("quiet"), `nothing new for ${JSON.parse(message.data).for_s.toFixed(0)} s`);
  });
  on("end", () => {
    ended = true;
    stream.close();
    link("ended", "The session has ended. This is its last state.");
  });
  stream.addEventListener("error", lost);
}

// The browser tries again by itself after most failures, but neither after a refusal nor on a line that is merely dead.
setInterval(() => {
  if (ended || performance.now() - heard < SILENCE_MS) return;
  if (heard) lost();
  if (stream.readyState !== EventSource.CONNECTING) connect();
}, 1000);

$("pause").addEventListener("click", () => {
  paused = !paused;
  $("pause").setAttribute("aria-pressed", paused);
  write($("pause"), paused ? "Go on drawing" : "Pause the drawings");
  schedule();
});
document.addEventListener("visibilitychange", () => { scheduled = false; schedule(); });
window.addEventListener("resize", schedule);
window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", schedule);
connect();
