// Loss of every material while the signal grows, named at the end of its line.

import { fixed, node, write } from "./frame.js";

const NS = "http://www.w3.org/2000/svg";
const LINE = 17;  // pixels between two names
const TOP = 12, BOTTOM = 26, LEFT = 40;

function drawn(name, attributes, text) {
  const made = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

// Names of a series differ at their ends: what is too long loses its middle.
function short(letters, most) {
  if (letters.length <= most) return letters.join("");
  const tail = Math.floor((most - 1) / 2);
  return `${letters.slice(0, most - 1 - tail).join("")}\u2026${tail ? letters.slice(-tail).join("") : ""}`;
}

// Names keep their order and a line's distance, and stay as near to their lines as that allows.
function spread(wanted, low, high) {
  const places = [...wanted];
  for (let i = 0; i < places.length; i += 1) {
    places[i] = Math.max(places[i], i ? places[i - 1] + LINE : low);
  }
  let below = high;
  for (let i = places.length - 1; i >= 0; i -= 1) {
    places[i] = Math.min(places[i], below);
    below = places[i] - LINE;
  }
  return places;
}

export class Ranking {
  constructor(place, list) {
    this.place = place;
    this.list = list;
    this.svg = drawn("svg", { role: "img", "aria-label": "Mean loss of each material over time; the list after it says the same" });
    place.append(this.svg);
    this.fits = new Map();
  }

  // Letters of one script are twice as wide as those of another: measured, and once only.
  fitted(name, kind, room) {
    const key = `${kind} ${room} ${name}`;
    if (!this.fits.has(key)) {
      if (this.fits.size > 5000) this.fits.clear();
      const letters = Array.from(new Intl.Segmenter().segment(name), (part) => part.segment);
      const probe = this.svg.appendChild(drawn("text", { class: kind }));
      let most = letters.length;
      do probe.textContent = short(letters, most);
      while (probe.getComputedTextLength() > room && (most -= 1) > 1);
      this.fits.set(key, probe.textContent);
      probe.remove();
    }
    return this.fits.get(key);
  }

  draw(frame) {
    const width = Math.max(this.place.clientWidth, 260);
    const wide = window.matchMedia("(min-width: 64.01rem)").matches;
    const height = Math.max(wide ? document.getElementById("axes").offsetHeight / 2 : 260, TOP + BOTTOM + LINE * (frame.classes.length + 1));
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.svg.style.height = `${height}px`;
    const n = frame.history_s.length;
    if (!n) {
      const words = frame.classes.length ? "The lines begin with the next capture." : "There is no model: nothing to rank.";
      this.svg.replaceChildren(drawn("text", { x: 0, y: 24, class: "empty" }, words));
      this.list.replaceChildren();
      return;
    }
    const gutter = Math.min(190, width * 0.45);
    const right = width - gutter, bottom = height - BOTTOM;
    const until = Math.max(frame.capture_s, frame.history_s[n - 1]);
    let low = Infinity, high = -Infinity;
    for (const losses of frame.history_losses) {
      for (const loss of losses) {
        if (loss < low) low = loss;
        if (loss > high && loss < Infinity) high = loss;
      }
    }
    if (low > high) [low, high] = [0, 1];  // none that can be drawn
    const span = Math.max(high - low, 1e-6);
    const x = (s) => LEFT + (right - LEFT) * (s / until);
    const y = (loss) => TOP + (bottom - TOP) * Math.min(1, (loss - low) / span);  // the smallest loss on top
    const parts = [];
    for (const share of [0, 0.5, 1]) {
      const level = low + share * span;
      parts.push(drawn("line", { x1: LEFT, x2: right, y1: y(level), y2: y(level) }));
      parts.push(drawn("text", { x: LEFT - 6, y: y(level) + 4, "text-anchor": "end", class: "tick" }, fixed(level, 2)));
    }
    const tick = until > 6 ? 2 : until > 1.5 ? 1 : 0.2;
    for (let i = 0; i * tick <= until * 1.0001; i += 1) {
      const words = `${Number((i * tick).toFixed(1))}${(i + 1) * tick > until * 1.0001 ? " s" : ""}`;
      parts.push(drawn("text", { x: x(i * tick), y: height - 8, "text-anchor": "middle", class: "tick" }, words));
    }
    const order = frame.classes.map((name, k) => ({ name, losses: frame.history_losses[k] }));
    order.sort((a, b) => a.losses[n - 1] - b.losses[n - 1]);
    const ends = order.map(({ losses }) => y(losses[n - 1]));
    const places = spread(ends, TOP, bottom);
    const at = x(frame.history_s[n - 1]);
    order.map(({ name, losses }, rank) => {
      const kind = ["first", "second"][rank] ?? "other";
      const points = Array.from(frame.history_s, (s, i) => `${x(s).toFixed(1)},${y(losses[i]).toFixed(1)}`);
      const tie = drawn("polyline", { class: "tie", points: `${at},${ends[rank]} ${right},${ends[rank]} ${right + 10},${places[rank]}` });
      const line = drawn("polyline", { class: kind, points: points.join(" ") });
      const loss = fixed(losses[n - 1], 3);
      const room = Math.round(gutter - 24 - 9 * loss.length);
      const words = drawn("text", { class: kind, x: right + 14, y: places[rank] + 4.5 }, this.fitted(name, kind, room));
      const number = drawn("text", { class: kind, x: width, y: places[rank] + 4.5, "text-anchor": "end" }, loss);
      return [tie, line, words, number];
    }).reverse().forEach((four) => parts.push(...four));  // the best is drawn last, on top
    this.svg.replaceChildren(...parts);
  }

  tell(frame) {
    const items = frame.ranking.map(([name, loss]) => `${name}, ${loss === null ? "unknown" : fixed(loss, 3)}`);
    if (this.list.children.length !== items.length) this.list.replaceChildren(...items.map(() => node("li")));
    items.forEach((text, i) => write(this.list.children[i], text));
  }
}
