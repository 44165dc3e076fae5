// What all pages share: elements, numbers, scales, and pictures that are zoomed and read by hand and by keys.
const $ = id => document.getElementById(id);
const NS = $("made").namespaceURI;
const main = $("main"), tip = $("tip");
const el = (tag, text, cls) => { const e = document.createElement(tag); if (text !== undefined && text !== null) e.textContent = text; if (cls) e.className = cls; return e; };
const draw = (parent, tag, attributes, text) => {
  const e = document.createElementNS(NS, tag);
  for (const [name, value] of Object.entries(attributes)) e.setAttribute(name, value);
  if (text !== undefined) e.textContent = text;
  parent.append(e);
  return e;
};
const num = (v, n = 2) => v === null || v === undefined ? "–" : v.toFixed(n).replace(/^-(0\.?0*)$/, "$1");
// An error in µm: three significant digits, and no finer than 0.01 µm.
const micrometres = v => {
  if (v === null || v === undefined) return "–";
  const size = Math.abs(v);
  if (size === 0) return "0";
  if (size < 0.005) return "<0.01";
  return v.toFixed(Math.min(Math.max(2 - Math.floor(Math.log10(+size.toPrecision(3))), 0), 2));
};
const few = v => v === null || v === undefined ? "–" : String(+v.toPrecision(3));
const section = title => { const s = el("section"); s.append(el("h2", title)); main.append(s); return s; };
const list = (parent, texts) => { if (!texts.length) return; const u = el("ul"); texts.forEach(x => u.append(el("li", x))); parent.append(u); };
const key = (text, colour, opacity = 1, shape = "") => { const k = el("span", text, `key ${shape}`); k.style.setProperty("--c", `var(${colour})`); k.style.setProperty("--o", opacity); return k; };
const BEFORE = { stroke: "var(--a)", fill: "var(--a)" }, AFTER = { stroke: "var(--b)", fill: "var(--b)" };

function table(head, rows, words = []) {
  const t = el("table"), h = el("tr"), cls = n => words.includes(n) ? "words" : "";
  head.forEach((x, n) => { const c = el("th", x, cls(n)); c.scope = "col"; h.append(c); });
  const top = el("thead"), body = el("tbody");
  top.append(h);
  rows.forEach(cells => { const r = el("tr"); cells.forEach((x, n) => r.append(el("td", x, cls(n)))); body.append(r); });
  t.append(top, body);
  return t;
}
// A row that leads somewhere, by hand or by keys.
function leads(row, does) {
  row.classList.add("go");
  row.tabIndex = 0;
  row.onclick = does;
  row.onkeydown = e => { if (e.key === "Enter" || e.key === " ") { e.preventDefault(); does(); } };
}
function scroll(...parts) { const s = el("div", undefined, "scroll"); s.tabIndex = 0; s.append(...parts); return s; }
function button(text, does, pressed) {
  const b = el("button", text);
  b.type = "button";
  if (pressed !== undefined) b.setAttribute("aria-pressed", pressed);
  b.onclick = () => does(b);
  return b;
}
// One of several: the names as buttons, of which one is pressed.
function choice(names, first, does) {
  const s = el("span", undefined, "one");
  names.forEach(name => s.append(button(name, b => { [...s.children].forEach(x => x.setAttribute("aria-pressed", x === b)); does(name); }, name === first), " "));
  return s;
}

// The largest of 1, 2 or 5 times a power of ten that is no larger.
function rounded(wish) {
  const power = 10 ** Math.floor(Math.log10(wish));
  return power * [5, 2, 1].find(k => k * power <= wish);
}
// A slider that magnifies up to 10,000 times; at first `size` becomes a twentieth of `extent`, or a little less.
function magnifier(what, extent, size) {
  const slider = el("input"), told = el("output"), box = el("label", `${what} × `);
  const m = { box, factor: size > 0 ? Math.min(Math.max(rounded(0.05 * extent / size), 1), 1e4) : 1 };
  const tell = () => {
    told.textContent = num(m.factor, m.factor < 10 ? 1 : 0);
    slider.setAttribute("aria-valuetext", `${what} times ${told.textContent}`);
  };
  Object.assign(slider, { type: "range", min: 0, max: 4, step: 0.02, id: "mag", value: Math.log10(m.factor) });
  slider.setAttribute("aria-label", `magnification: ${what}`);
  slider.oninput = () => { m.factor = 10 ** +slider.value; tell(); redraw(); };
  box.append(slider, " ", told);
  tell();
  return m;
}

// Steps of 1, 2 or 5 times a power of ten.
function ticks(low, high, most) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const power = 10 ** Math.floor(Math.log10(span / most));
  const step = [1, 2, 5, 10].map(k => k * power).find(s => span / s <= most);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * span; k++) found.push(+(k * step).toPrecision(12));
  return found;
}
const extent = (lists, room = 0.06) => {
  let low = Infinity, high = -Infinity;
  for (const one of lists) for (const v of one) if (v !== null && v !== undefined) { if (v < low) low = v; if (v > high) high = v; }
  if (low > high) return [-1, 1];
  const more = room * ((high - low) || Math.abs(high) || 1);
  return [low - more, high + more];
};
// The last of ascending values that is no larger.
const at = (ts, t) => { let a = 0, b = ts.length; while (a < b) { const m = (a + b) >> 1; if (ts[m] <= t) a = m + 1; else b = m; } return Math.max(a - 1, 0); };

// What is drawn. All pictures are drawn anew when one of them is moved, at most once a frame.
const pictures = [];
let waiting = false;
const everything = () => pictures.forEach(one => one());
const redraw = () => { if (!waiting) { waiting = true; requestAnimationFrame(() => { waiting = false; everything(); }); } };
addEventListener("resize", redraw);
addEventListener("beforeprint", everything);

// A line through n places in pixels; where `shown` is false it is broken. What nobody can see is left out:
// steps of less than half a pixel, and what lies beyond one edge of the box.
function strokes(n, x, y, shown, [left, top, right, low]) {
  const out = [], side = (u, v) => (u < left ? 1 : u > right ? 2 : 0) | (v < top ? 4 : v > low ? 8 : 0);
  // `held` is the place before, where it is not drawn yet; `hidden` says that nobody sees the way to it.
  let begun = false, hidden = false, held = null, code = 0, lu = 0, lv = 0;
  const put = ([u, v], word) => { out.push(`${word}${u.toFixed(1)} ${v.toFixed(1)}`); lu = u; lv = v; held = null; };
  for (let k = 0; k <= n; k++) {
    const there = k < n && shown(k), here = there ? [x(k), y(k)] : null, c = there ? side(...here) : 0;
    if (!there || (begun && c & code)) {
      if (begun && held && !hidden) put(held, "L");
      begun = there; held = here; hidden = true;
    } else if (!begun) {
      begun = true; held = here; hidden = true;
    } else {
      if (hidden) { put(held, "M"); hidden = false; }
      if (Math.abs(here[0] - lu) >= 0.5 || Math.abs(here[1] - lv) >= 0.5) put(here, "L"); else held = here;
    }
    code = c;
  }
  return out.join("");
}
// Neighbours among n places of which `of` says the same: first and last place of each stretch, and what it says.
function stretches(n, of) {
  const found = [];
  for (let k = 0; k < n; k++) {
    const last = found[found.length - 1], said = of(k);
    if (last && last.said === said) last.to = k; else found.push({ from: k, to: k, said });
  }
  return found;
}
// A line of which some steps are drawn; `drawn` says it of the step that ends in a place.
const steps = (n, x, y, drawn, box) => stretches(n, k => k > 0 && drawn(k)).filter(one => one.said)
  .map(({ from, to }) => strokes(to - from + 2, k => x(from - 1 + k), k => y(from - 1 + k), () => true, box)).join("");
const DASHES = { "stroke-dasharray": "3 4" };
const LINE = { fill: "none", "stroke-width": 1.6, "stroke-linejoin": "round" };
function line(parent, xs, ys, X, Y, attributes) {
  const d = strokes(xs.length, k => X(xs[k]), k => Y(ys[k]), k => ys[k] !== null, [-1e4, -1e4, 1e4, 1e4]);
  draw(parent, "path", { ...LINE, d, ...attributes });
}

// What is pointed at, in words beside the hand.
function show(x, y, text) {
  tip.style.display = text ? "block" : "none";
  tip.textContent = text || "";
  if (!text) return;
  const r = tip.getBoundingClientRect();
  tip.style.left = `${Math.max(4, x + 14 + r.width > innerWidth ? x - r.width - 10 : x + 14)}px`;
  tip.style.top = `${Math.max(4, y + 14 + r.height > innerHeight ? y - r.height - 10 : y + 14)}px`;
}

// Wheel, drag, pinch, double click and keys of a picture: `does` has zoom(factor, x, y), pan(x, y), reset(),
// and perhaps hover(x, y, event), leave() and step(sign). Places are pixels in the picture.
function hand(svg, does) {
  const held = new Map();
  const place = e => { const r = svg.getBoundingClientRect(); return [e.clientX - r.left, e.clientY - r.top]; };
  const middle = () => [svg.clientWidth / 2, svg.clientHeight / 2];
  const then = (...rest) => { does.zoom(...rest); redraw(); };
  svg.setAttribute("tabindex", 0);
  svg.addEventListener("wheel", e => { e.preventDefault(); then(Math.exp(-e.deltaY * (e.deltaMode ? 0.05 : 0.0015)), ...place(e)); }, { passive: false });
  svg.ondblclick = () => { does.reset(); redraw(); };
  svg.onpointerdown = e => { held.set(e.pointerId, place(e)); svg.setPointerCapture(e.pointerId); if (e.pointerType === "touch" && does.hover) does.hover(...place(e), e); };
  svg.onpointerup = svg.onpointercancel = e => { held.delete(e.pointerId); };
  // A finger that was lifted has told what to read.
  svg.onpointerleave = e => { if (e.pointerType === "touch") return; if (does.leave) does.leave(); show(); };
  svg.onpointermove = e => {
    const here = place(e), from = held.get(e.pointerId);
    if (!from) { if (does.hover) does.hover(...here, e); return; }
    held.set(e.pointerId, here);
    if (held.size === 1) { does.pan(here[0] - from[0], here[1] - from[1]); redraw(); return; }
    const other = [...held].find(([id]) => id !== e.pointerId)[1], far = p => Math.hypot(p[0] - other[0], p[1] - other[1]);
    then(Math.max(far(here), 1) / Math.max(far(from), 1), (here[0] + other[0]) / 2, (here[1] + other[1]) / 2);
  };
  svg.addEventListener("keydown", e => {
    const way = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[e.key], by = 0.1 * svg.clientWidth;
    if (e.ctrlKey || e.metaKey || e.altKey) return;
    if (e.key === "+" || e.key === "=") does.zoom(1.25, ...middle());
    else if (e.key === "-") does.zoom(0.8, ...middle());
    else if (e.key === "0" || e.key === "Home") does.reset();
    else if (e.key === "Escape") { if (does.leave) does.leave(); show(); }
    else if (way && (e.shiftKey || !does.step)) does.pan(way[0] * by, way[1] * by);
    else if (way && way[0] && does.step) does.step(-way[0]);
    else return;
    e.preventDefault(); redraw();
  });
  svg.onblur = () => { if (does.leave) does.leave(); show(); };
}

// What several charts show of one quantity: they are zoomed and moved together.
class Range {
  constructor(low, high) { this.full = [low, high > low ? high : low + 1]; this.reset(); }
  reset() { [this.low, this.high] = this.full; }
  set(low, high) { this.low = Math.max(low, this.full[0]); this.high = Math.min(high, this.full[1]); }
  zoom(factor, x) {
    const span = (this.high - this.low) / factor;
    if (span < 1e-7 * (this.full[1] - this.full[0])) return;
    this.set(x - (x - this.low) / factor, x + (this.high - x) / factor);
  }
  pan(by) {
    by = Math.min(Math.max(by, this.full[0] - this.low), this.full[1] - this.high);
    this.low += by; this.high += by;
  }
}

// A frame with its axes; X and Y take values to the picture.
const LEFT = 58, RIGHT = 10, TOP = 8, LOW = 36;
function frame(svg, height, x0, x1, y0, y1, xlabel, ylabel) {
  svg.textContent = "";
  const width = Math.max(svg.clientWidth || 700, 200);
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  svg.setAttribute("height", height);
  const X = x => LEFT + (x - x0) / ((x1 - x0) || 1) * (width - LEFT - RIGHT);
  const Y = y => height - LOW - (y - y0) / ((y1 - y0) || 1) * (height - LOW - TOP);
  for (const y of ticks(y0, y1, 5)) {
    draw(svg, "line", { x1: LEFT, x2: width - RIGHT, y1: Y(y), y2: Y(y), stroke: "var(--line)", "stroke-width": y === 0 ? 2 : 1 });
    draw(svg, "text", { x: LEFT - 6, y: Y(y) + 4, "text-anchor": "end", class: "y" }, String(y));
  }
  for (const x of ticks(x0, x1, Math.max(3, width / 110))) {
    draw(svg, "line", { x1: X(x), x2: X(x), y1: height - LOW, y2: height - LOW + 4, stroke: "var(--dim)" });
    draw(svg, "text", { x: X(x), y: height - LOW + 16, "text-anchor": "middle", class: "x" }, String(x));
  }
  draw(svg, "text", { x: width - RIGHT, y: height - 4, "text-anchor": "end" }, xlabel);
  draw(svg, "text", { x: 12, y: TOP + (height - LOW - TOP) / 2, "text-anchor": "middle", transform: `rotate(-90 12 ${TOP + (height - LOW - TOP) / 2})` }, ylabel);
  const clip = "clip" + (frame.count = (frame.count || 0) + 1);
  const c = draw(svg, "clipPath", { id: clip });
  draw(c, "rect", { x: LEFT, y: TOP - 4, width: width - LEFT - RIGHT, height: height - LOW - TOP + 8 });
  const inside = draw(svg, "g", { "clip-path": `url(#${clip})` });
  const box = [LEFT, TOP, width - RIGHT, height - LOW];
  // What lies to the sides of the box is left out of its lines; above and below there is always more to see.
  return { inside, X, Y, width, height, box, lane: [LEFT - 20, -1e5, width - RIGHT + 20, 1e5], x: px => x0 + (px - LEFT) / (width - LEFT - RIGHT) * (x1 - x0) };
}
// Into a frame: what lies between two values, one value of either axis.
function shade(f, a, b, attributes, parent = f.inside) {
  const [left, top, right, low] = f.box, x = f.X(a), width = Math.max(f.X(b) - x, 0.8);
  if (x <= right && x + width >= left) draw(parent, "rect", { x, y: top, width, height: low - top, ...attributes });
}
const upright = (f, x, attributes, parent = f.inside) => draw(parent, "line", { x1: f.X(x), x2: f.X(x), y1: f.box[1], y2: f.box[3], stroke: "var(--ink)", ...attributes });
const level = (f, y, attributes) => draw(f.inside, "line", { x1: f.box[0], x2: f.box[2], y1: f.Y(y), y2: f.Y(y), stroke: "var(--ink)", ...attributes });
function picture(parent, label, cls, told = true) {
  const box = el("div", undefined, "chart"), svg = document.createElementNS(NS, "svg");
  if (cls) svg.setAttribute("class", cls);
  svg.setAttribute("role", "img"); svg.setAttribute("aria-label", label);
  if (told) box.append(el("p", label));
  box.append(svg); parent.append(box);
  return svg;
}
// A chart over a range that it shares: `ys` gives its lowest and highest value, `paint` draws into its frame;
// `does` has hover, leave and step as `hand` wants them, but hover(value, x, y, event).
function chart(svg, range, height, xlabel, ylabel, ys, paint, does = {}) {
  let f = null;
  pictures.push(() => { const [low, high] = ys(); f = frame(svg, height, range.low, range.high, low, high, xlabel, ylabel); paint(f); });
  hand(svg, {
    ...does,
    zoom: (factor, x) => range.zoom(factor, f.x(x)),
    pan: x => range.pan(-x / (f.box[2] - f.box[0]) * (range.high - range.low)),
    reset: () => range.reset(),
    ...(does.hover ? { hover: (x, y, e) => does.hover(f.x(x), x, y, e) } : {}),
  });
  return () => f;
}

// A view of a plane with the same scale on both axes: `bounds` gives [[x0, x1], [y0, y1]].
function plane(svg, height, labels, bounds, paint, does = {}) {
  const v = { x: 0, y: 0, scale: 0, width: 0, height: 0 };
  v.X = x => v.width / 2 + (x - v.x) * v.scale;
  v.Y = y => v.height / 2 - (y - v.y) * v.scale;
  v.fit = ([[x0, x1], [y0, y1]] = bounds(), room = 0.86) => {
    const size = Math.max(x1 - x0, y1 - y0, 1e-9);
    v.x = (x0 + x1) / 2; v.y = (y0 + y1) / 2;
    v.scale = room * Math.min((v.width - 50) / Math.max(x1 - x0, 1e-3 * size), (v.height - 30) / Math.max(y1 - y0, 1e-3 * size));
  };
  v.whole = true;
  pictures.push(() => {
    const width = Math.max(svg.clientWidth || 700, 200), tall = height(width);
    const same = v.width === width && v.height === tall;
    v.width = width; v.height = tall;
    if (v.whole && !same || !v.scale) v.fit();
    svg.textContent = "";
    svg.setAttribute("viewBox", `0 0 ${width} ${tall}`); svg.setAttribute("height", tall);
    v.box = [-20, -20, width + 20, tall + 20];
    const half = [width / 2 / v.scale, tall / 2 / v.scale], [u, w] = labels();
    for (const x of ticks(v.x - half[0], v.x + half[0], Math.max(4, width / 75))) {
      draw(svg, "line", { x1: v.X(x), x2: v.X(x), y1: 0, y2: tall, stroke: "var(--line)", "stroke-width": 0.6 });
      if (v.X(x) > 50 && v.X(x) < width - 70) draw(svg, "text", { x: v.X(x), y: tall - 6, "text-anchor": "middle", class: "x" }, String(x));
    }
    for (const y of ticks(v.y - half[1], v.y + half[1], Math.max(4, tall / 55))) {
      draw(svg, "line", { x1: 0, x2: width, y1: v.Y(y), y2: v.Y(y), stroke: "var(--line)", "stroke-width": 0.6 });
      if (v.Y(y) > 26 && v.Y(y) < tall - 22) draw(svg, "text", { x: 6, y: v.Y(y) + 4, class: "y" }, String(y));
    }
    draw(svg, "text", { x: width - 8, y: tall - 6, "text-anchor": "end" }, u);
    draw(svg, "text", { x: 6, y: 16 }, w);
    v.inside = draw(svg, "g", {});
    paint(v);
  });
  hand(svg, {
    ...does,
    zoom: (factor, x, y) => {
      const px = v.x + (x - v.width / 2) / v.scale, py = v.y - (y - v.height / 2) / v.scale;
      if (v.scale * factor > 1e9 || v.scale * factor < 1e-6) return;
      v.scale *= factor; v.x = px - (px - v.x) / factor; v.y = py - (py - v.y) / factor; v.whole = false;
    },
    pan: (x, y) => { v.x -= x / v.scale; v.y += y / v.scale; v.whole = false; },
    reset: () => { v.whole = true; v.fit(); if (does.reset) does.reset(); },
  });
  return v;
}
// How long something of a round size is drawn that is magnified: `pixels` to its unit.
function ruler(v, what, unit, pixels) {
  const size = rounded(90 / pixels), long = size * pixels, x = v.width - 16 - long, y = 24;
  draw(v.inside, "path", { d: `M${x} ${y - 4}V${y + 4}M${x} ${y}H${x + long}M${x + long} ${y - 4}V${y + 4}`, stroke: "var(--ink)", "stroke-width": 1.4, fill: "none" });
  draw(v.inside, "text", { x: x + long, y: y - 9, "text-anchor": "end", class: "ink" }, `${what} of ${+size.toPrecision(3)} ${unit}`);
}
const HINT = "wheel, pinch or + − zooms; dragging or shift + arrows moves; double click or 0 shows all";
