// Takes what the server sends, and shows it as fast as this browser can, but no faster than an eye can read.

import { node, read, write } from "./frame.js";
import { Ranking } from "./ranking.js";
import { Axes } from "./traces.js";

const WORDS_MS = 160;  // numbers that change faster cannot be read
const SPEECH_MS = 1500;  // a screen reader must be able to end its sentence
const SILENCE_MS = 4000;  // the server says something every second: after this the line is dead
const calm = window.matchMedia("(prefers-reduced-motion: reduce)");
const $ = (id) => document.getElementById(id);

const axes = new Axes($("axes"));
const ranking = new Ranking($("ranking"), $("ranking-list"));
let newest = null, frame = null, scheduled = false, paused = false, ended = false;
let words = 0, drawings = 0, spoken = 0, heard = 0, stream = null;

function link(state, text) {
  if (document.body.dataset.link !== state) document.body.dataset.link = state;
  $("trouble").hidden = !text;
  write($("trouble"), text);
}

function figures(list) {
  const place = $("figures");
  const names = list.map(([name]) => name).join();
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
  const place = $("warnings");
  place.hidden = !list.length;
  if (place.dataset.text === list.join("\n")) return;
  place.dataset.text = list.join("\n");
  place.replaceChildren(...list.map((text) => node("li", {}, text)));
}

function speak(now) {
  const { kind, title, detail } = frame.answer;
  const given = kind === "final" || kind === "unknown";
  const text = given ? `Final answer: ${title}, ${detail}` : kind === "none" ? frame.state_name : `${title}, ${kind}`;
  if ($("spoken").textContent === text || (now - spoken < SPEECH_MS && !given && kind !== "failed")) return;
  spoken = now;
  write($("spoken"), text);
}

function tell(now) {
  const { kind, title, stage, detail } = frame.answer;
  $("top").dataset.kind = kind;
  write($("title"), title);
  write($("stage"), stage);
  write($("detail"), detail);
  write($("state"), frame.state_name);
  write($("score"), frame.score);
  write($("source"), ["granular_id live", frame.source, frame.synthetic && "SYNTHETIC", `${frame.rate_hz} Hz`].filter(Boolean).join(" \u00b7 "));
  write($("synthetic"), frame.synthetic);
  $("synthetic").hidden = !frame.synthetic;
  const seen = frame.history_s.length ? frame.history_s[frame.history_s.length - 1] : 0;
  $("progress").style.transform = `scaleX(${kind === "none" || kind === "failed" ? 0 : Math.min(1, seen / frame.capture_s)})`;
  document.title = `${frame.synthetic ? "SYNTHETIC: " : ""}${title} \u00b7 granular_id live`;
  figures(frame.figures);
  warnings(frame.warnings);
  speak(now);
  if (!paused) {
    axes.values(frame);
    ranking.tell(frame);
  }
  document.body.dataset.number = frame.number;
}

function show() {
  scheduled = false;
  const now = performance.now();
  if (newest !== null) {
    frame = read(newest);
    newest = null;
  }
  if (frame === null) return;
  let later = 0;
  if (now - words >= WORDS_MS) {
    words = now;
    tell(now);
  } else later = WORDS_MS - (now - words);
  if (!paused && !document.hidden) {
    const rest = (calm.matches ? 500 : 0) - (now - drawings);
    if (rest <= 0) {
      drawings = now;
      axes.draw(frame);
      ranking.draw(frame);
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

function connect() {
  stream?.close();
  stream = new EventSource("events");
  const alive = () => { heard = performance.now(); };
  stream.addEventListener("open", () => { alive(); link("open", ""); });
  stream.addEventListener("snapshot", (message) => {
    alive();
    link("open", "");
    write($("quiet"), "");
    newest = message.data;
    schedule();
  });
  stream.addEventListener("quiet", (message) => {
    alive();
    link("quiet", "");
    write($("quiet"), `nothing new for ${JSON.parse(message.data).for_s.toFixed(0)} s`);
  });
  stream.addEventListener("end", () => {
    ended = true;
    stream.close();
    write($("quiet"), "");
    link("ended", "The session has ended. This is its last state.");
  });
  stream.addEventListener("error", lost);
}

function lost() {
  if (ended) return;
  write($("quiet"), "");
  link("lost", "The connection to the session is lost. Trying again \u2026 what is shown is old.");
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
