// Draws what the server sends. All words and numbers come from there; curves are shares of the place they are drawn in.

const DRAW_MS = window.matchMedia("(prefers-reduced-motion: reduce)").matches ? 500 : 100;
const SILENCE_MS = 4000;  // the server sends something every second: after this the line is dead
const LONG = 26;  // letters; more are set smaller
const NAME_PX = 17;  // from one name to the next

const $ = (id) => document.getElementById(id);
const floats = (text) => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);

function node(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

// What has not changed is not written again: screen readers and selections stay where they are.
function write(place, text) {
  if (place.textContent !== text) place.textContent = text;
}

const listed = new Map();

function list(id, items, make) {
  const text = JSON.stringify(items);
  if (listed.get(id) === text) return;
  listed.set(id, text);
  $(id).replaceChildren(...items.map(make));
}

// Words: the answer, the health of the stream, warnings, the history.

function tell(frame) {
  const { kind, title, stage, detail } = frame.answer;
  $("top").dataset.kind = kind;
  $("title").classList.toggle("long", title.length > LONG);
  const { source, state, score, synthetic, spoken } = frame;
  for (const [id, text] of Object.entries({ title, stage, detail, source, state, score, synthetic, spoken })) write($(id), text);
  document.title = `${synthetic ? "SYNTHETIC: " : ""}${title}${kind === "provisional" ? " so far" : ""} \u00b7 granular_id live`;
  $("progress").style.transform = `scaleX(${frame.progress})`;
  list("figures", frame.figures, ([name, value, alarm]) =>
    node("div", alarm ? { class: "alarm" } : {}, node("dt", {}, name), node("dd", {}, value)));
  list("warnings", frame.warnings, (text) => node("li", {}, text));
  list("history", frame.history, (one) => node("li", { value: one.number, "data-kind": one.kind },
    node("span", { class: "when" }, node("b", {}, one.number), " ", node("time", {}, one.clock)),
    node("bdi", { class: "name" }, one.title),
    node("span", { class: "more" }, one.detail),
    ...one.warnings.map((text) => node("span", { class: "warned" }, text))));
}

// Curves.

function path(x, y) {
  let d = "", pen = "M";
  y.forEach((value, i) => {
    if (!Number.isNaN(value)) d += `${pen}${x[i].toFixed(4)},${value.toFixed(4)}`;
    pen = Number.isNaN(value) ? "M" : "L";  // rows that never came are a gap
  });
  return d;
}

// Names keep their order and a line's distance, and stay as near to their lines as that allows.
function spread(wanted, high) {
  const places = [...wanted];
  for (let i = 1; i < places.length; i += 1) places[i] = Math.max(places[i], places[i - 1] + NAME_PX);
  for (let i = places.length - 1, below = high; i >= 0; i -= 1, below = places[i + 1] - NAME_PX) places[i] = Math.min(places[i], below);
  return places;
}

// Loss of every material while the signal grows, named at the end of its line.
function ranking(sent) {
  const { names = [], curves = [], at = "", levels = [], ticks = [] } = sent ?? {};
  list("levels", levels, (text) => node("span", {}, text));
  list("ticks", ticks, ([, text]) => node("span", {}, text));
  ticks.forEach(([share], i) => { $("ticks").children[i].style.left = `${100 * share}%`; });
  list("ranking", names, ([name, loss]) => node("li", {}, node("bdi", {}, name), node("span", {}, loss)));
  $("chart").style.setProperty("--n", names.length);
  const { width, height } = $("lines").getBoundingClientRect(), x = floats(at), losses = curves.map(floats);
  const places = spread(losses.map((y) => y.at(-1) * height), height);
  places.forEach((place, k) => { $("ranking").children[k].style.top = `${place}px`; });
  const ties = places.map((place, k) => `M${x.at(-1)},${losses[k].at(-1)}H1L${1 + 10 / width},${place / height}`);
  const [best = "", second = "", ...others] = losses.map((y) => path(x, y));
  for (const [id, d] of Object.entries({ best, second, others: others.join(""), ties: ties.join("") })) $(id).setAttribute("d", d);
}

// One row per axis: its value, its last seconds, what the high-pass leaves, and the histogram of that.
function makeAxes(axes) {
  $("axes").replaceChildren(...axes.map(({ name, unit }, i) => {
    const row = $("axis").content.firstElementChild.cloneNode(true);
    row.style.setProperty("--mark", `var(--okabe-${i % 6})`);
    row.querySelector(".name").append(...(/^[FTft][xyz]$/.test(name) ? [name[0].toUpperCase(), node("sub", {}, name[1])] : [name]));
    row.querySelector(".unit").append(unit);
    row.querySelectorAll("svg").forEach((svg) => svg.setAttribute("aria-label", `${name}, ${svg.parentNode.className}`));
    return row;
  }));
}

function draw(frame) {
  if ($("axes").children.length !== frame.axes.length) makeAxes(frame.axes);
  for (const [name, text] of Object.entries(frame.captions)) document.querySelectorAll(`.about-${name}`).forEach((one) => write(one, text));
  const at = floats(frame.at);
  frame.axes.forEach((axis, i) => {
    const row = $("axes").children[i];
    write(row.querySelector(".value"), axis.value);
    for (const kind of ["wrench", "residual", "bins"]) {
      const figure = row.querySelector(`.${kind}`), { shares, zero, ...labels } = axis[kind], y = floats(shares);
      for (const [name, text] of Object.entries(labels)) write(figure.querySelector(`.${name}`), text);
      if (kind === "bins") {
        const bar = 1 / y.length, bars = Array.from(y, (share, k) => (share ? `M${k * bar},1v${-share}h${bar}v${share}z` : ""));
        figure.querySelector(".bars").setAttribute("d", bars.join(""));
      } else {
        figure.querySelector(".grid").setAttribute("d", `M0,0H1M0,1H1M0,${1 - zero}H1`);
        figure.querySelector(".line").setAttribute("d", path(at, y.map((share) => 1 - share)));
      }
    }
  });
  ranking(frame.ranking);
}

let newest = null, drawn = null, paused = false;

setInterval(() => {
  if (newest === drawn || paused || document.hidden) return;
  draw(newest);
  drawn = newest;
  document.body.dataset.drawn = drawn.number;
}, DRAW_MS);

$("pause").addEventListener("click", () => {
  paused = !paused;
  $("pause").setAttribute("aria-pressed", paused);
  write($("pause"), paused ? "Go on drawing" : "Pause the drawings");
});
window.addEventListener("resize", () => { drawn = null; });

// The line to the server.

let heard = 0, changed = 0, stream = null;

function link(state, text = "", quiet = "") {
  document.body.dataset.link = state;
  write($("trouble"), text);
  write($("quiet"), quiet);
}

function lost() {
  link("lost", "The connection to the session is lost. Trying again \u2026 what is shown is old.");
}

function connect() {
  stream?.close();
  stream = new EventSource("events");
  heard = performance.now();
  const on = (kind, then) => stream.addEventListener(kind, (message) => {
    heard = performance.now();
    then(message.data);
  });
  on("snapshot", (data) => {
    changed = heard;
    newest = JSON.parse(data);
    link("open");
    tell(newest);
  });
  on("quiet", () => link("quiet", "", `nothing new for ${((heard - changed) / 1000).toFixed(0)} s`));
  on("end", () => {
    clearInterval(watch);
    stream.close();
    link("ended", "The session has ended. This is its last state.");
  });
  stream.addEventListener("error", lost);
}

// The browser tries again by itself after most failures, but not on a line that is merely dead.
const watch = setInterval(() => {
  if (performance.now() - heard < SILENCE_MS) return;
  lost();
  connect();
}, 1000);
connect();
