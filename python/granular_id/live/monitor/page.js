// Takes what the server sends, and shows it as fast as this browser can, but no faster than an eye can read.

import { node, read, write } from "./frame.js";
import { Ranking } from "./ranking.js";
import { Axes } from "./traces.js";

const WORDS_MS = 160;  // numbers that change faster cannot be read
const SPEECH_MS = 1500;  // a screen reader must be able to end its sentence
const LONG = 26;  // letters; more are set smaller
const SILENCE_MS = 4000;  // the server says something every second: after this the line is dead
const calm = window.matchMedia("(prefers-reduced-motion: reduce)");
const $ = (id) => document.getElementById(id);

const axes = new Axes($("axes"));
const ranking = new Ranking($("ranking"), $("ranking-list"));
let newest = null, frame = null, scheduled = false, paused = false, ended = false;
let spoken = { number: 0, at: 0, state: "" };
let words = 0, drawings = 0, heard = 0, stream = null;

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

function history(list) {
  const place = $("history"), newest = list[0]?.number ?? 0;
  if (Number(place.dataset.newest ?? 0) === newest) return;
  place.dataset.newest = newest;
  write($("history-note"), `The newest is on top${newest > list.length ? `; the last ${list.length} of ${newest}` : ""}.`);
  place.replaceChildren(...list.map(({ number, clock, kind, title, detail, warnings }) => {
    const line = node("li", { value: number, "data-kind": kind },
      node("span", { class: "when" }, node("b", {}, number), " ", node("time", {}, clock)),
      node("bdi", { class: "name" }, title),
      node("span", { class: "more" }, detail));
    for (const text of warnings) line.append(node("span", { class: "warned" }, text));
    return line;
  }));
}

// What came of a push is spoken as it comes; states as slowly as a sentence takes; provisional answers never.
function speak(now) {
  const last = frame.history[0];
  if (last && last.number !== spoken.number) {
    const { kind, title, detail } = last;
    const begin = kind === "final" || kind === "unknown" ? "Final answer: " : "";
    write($("spoken"), `Push ${last.number}. ${begin}${[title, detail, ...last.warnings].filter(Boolean).join(", ")}`);
    spoken = { number: last.number, at: now, state: "" };
  } else if (frame.state_name !== spoken.state && now - spoken.at >= SPEECH_MS && frame.state !== "complete") {
    write($("spoken"), frame.state_name);
    spoken = { ...spoken, at: now, state: frame.state_name };
  }
}

function tell(now) {
  const { kind, title, stage, detail } = frame.answer;
  $("top").dataset.kind = kind;
  write($("title"), title);
  $("title").classList.toggle("long", title.length > LONG);
  write($("stage"), stage);
  write($("detail"), detail);
  write($("state"), frame.state_name);
  write($("score"), frame.score);
  write($("source"), ["granular_id live", frame.source, frame.synthetic && "SYNTHETIC", `${frame.rate_hz} Hz`].filter(Boolean).join(" \u00b7 "));
  write($("synthetic"), frame.synthetic);
  $("synthetic").hidden = !frame.synthetic;
  const seen = frame.history_s.length ? frame.history_s[frame.history_s.length - 1] : 0;
  $("progress").style.transform = `scaleX(${kind !== "provisional" ? Number(frame.state === "complete") : Math.min(1, seen / frame.capture_s)})`;
  document.title = `${frame.synthetic ? "SYNTHETIC: " : ""}${title}${kind === "provisional" ? " so far" : ""} \u00b7 granular_id live`;
  figures(frame.figures);
  warnings(frame.warnings);
  history(frame.history);
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
  const isAnother = frame.answer.kind !== $("top").dataset.kind;  // drawings do not run ahead of the words
  if (isAnother || now - words >= WORDS_MS) {
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
