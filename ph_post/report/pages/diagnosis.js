// A diagnosis: the verdict, the gap per step, what is missing, and the residuals before and after.
// The verdict.
{
  D.words.forEach((text, k) => main.append(el("h1", text)));
  const facts = [D.log && `log ${D.log}`, `machine ${D.machine}`, D.remarks].filter(Boolean);
  main.append(el("p", facts.join(" · "), "dim"));
}

// The gap per step.
if (D.gap.steps.length) {
  const s = section("Residual between log and model"), floor = D.gap.noise_floor;
  const names = D.labels.map(label => label === null ? "original machine file" : `+ ${label}`);
  const micro = v => micrometres(v === null ? null : 1000 * v);
  const times = v => v === null || !floor ? "–" : v / floor < 1e5 ? num(v / floor, 1) : (v / floor).toExponential(0);
  s.append(scroll(table(["step", "fitted, µm rms", "held out, µm rms", "times the noise floor"],
    D.gap.steps.map((step, k) => [names[k], micro(step.fit_rms), micro(step.holdout_rms), times(step.holdout_rms)]))));
  const bar = el("div", undefined, "bar");
  bar.append(key("fitted", "--b", 0.45), key("held out", "--b", 1));
  if (floor) bar.append(key(`noise floor, ${micro(floor)} µm`, "--a", 1, "thin"));
  s.append(bar);
  const svg = picture(s, "the residual of each step, as bars", "", false);
  pictures.push(() => {
    svg.textContent = "";
    const width = Math.min(svg.clientWidth || 700, 800), row = 40;
    const height = row * names.length + 8, top = Math.max(floor || 0, ...D.gap.steps.flatMap(x => [x.fit_rms || 0, x.holdout_rms || 0])) || 1;
    svg.setAttribute("viewBox", `0 0 ${svg.clientWidth || 700} ${height}`); svg.setAttribute("height", height);
    const labels = names.map((name, k) => draw(svg, "text", { x: 0, y: row * k + 22, class: "ink" }, name));
    const left = Math.min(Math.max(...labels.map(label => label.getBBox().width)) + 12, width * 0.55);
    const X = v => left + v / top * (width - left - 70);
    D.gap.steps.forEach((step, k) => {
      [["fit_rms", 4, 0.45], ["holdout_rms", 18, 1]].forEach(([name, y, opacity]) => {
        if (step[name] === null) return;
        draw(svg, "rect", { x: left, y: row * k + y, width: Math.max(X(step[name]) - left, 1), height: 12, fill: "var(--b)", opacity });
        draw(svg, "text", { x: X(step[name]) + 6, y: row * k + y + 10 }, `${micro(step[name])} µm`);
      });
    });
    if (floor) draw(svg, "line", { x1: X(floor), x2: X(floor), y1: 0, y2: height - 8, stroke: "var(--a)", "stroke-width": 2, "stroke-dasharray": "4 3" });
  });
}

// What was found.
if (D.effects.length) {
  const s = section(D.verdict === "ambiguous" ? "What explains the log" : "What is missing");
  D.effects.forEach((effect, k) => {
    s.append(el("h3", D.titles[k]));
    const about = [effect.where, effect.confidence === null ? "" : `${(100 * effect.confidence).toFixed(0)} % sure`].filter(Boolean);
    s.append(el("p", about.join(" · "), "dim"));
    s.append(scroll(table(["parameter", "value", "standard error", "unit"],
      Object.entries(D.estimates[k]).map(([name, [value, error]]) => [name, value, error === null ? "unknown" : `± ${error}`, effect.parameters[name].unit]))));
    list(s, effect.evidence);
    if (D.rivals[k].length) s.append(el("p", `Not separable from: ${D.rivals[k].join(", ")}`));
  });
}

// What to run next.
if (D.next_experiment) {
  const one = D.next_experiment, s = section(`What to run next: ${one.name}`);
  s.append(el("p", one.why), el("p", "To log:"));
  list(s, one.record);
  s.append(el("pre", one.program));
}

// What else there is to know.
if (D.notes.length) list(section("What else to know"), D.notes);

// Where it lies.
for (const [title, places] of [["Where machine file and log differ by more than noise, the excess", D.places], ["What remains", D.gap.steps.length > 1 ? D.remaining : []]]) {
  if (!places.length) continue;
  const s = section(title), axes = [...new Set(places.map(one => one.axis))];
  // The axis with most of it comes first, as the places do.
  [...places].sort((a, b) => axes.indexOf(a.axis) - axes.indexOf(b.axis) || (b.share || 0) - (a.share || 0)).forEach(place => {
    const p = el("p"), share = el("span", undefined, "share"), fill = el("i");
    fill.style.width = `${Math.min(Math.max(100 * (place.share || 0), 0), 100)}%`;
    share.append(fill); share.title = "share of what is above the noise floor";
    p.append(share, axes.length > 1 ? `${place.axis}: ${place.sentence}` : place.sentence); s.append(p);
  });
}

// The residuals. All charts over time share one range.
const end = Math.max(0, ...D.trails.map(x => x.end));
const range = new Range(0, end);
const changed = D.gap.steps.length > 1;
const HELD_OUT = { fill: "var(--line)", opacity: 0.4 }, NOISE = { "stroke-dasharray": "2 4" };

// Groups that are drawn: neighbours are merged until no more are left than the picture has columns.
function merged(trail, name, columns) {
  const from = at(trail.t, range.low), to = Math.min(at(trail.t, range.high) + 2, trail.t.length), group = Math.max(1, Math.floor((to - from) / columns));
  const t = [], low = [], high = [], [l, h] = trail[name];
  for (let k = from; k < to; k += group) {
    let a = null, b = null;
    for (let i = k; i < Math.min(k + group, to); i++) if (l[i] !== null) { if (a === null || l[i] < a) a = l[i]; if (b === null || h[i] > b) b = h[i]; }
    t.push(trail.t[k]); low.push(a); high.push(b);
  }
  return { t, low, high };
}
function band(parent, one, X, Y, attributes) {
  let path = "", k = 0;
  const n = one.t.length;
  while (k < n) {
    if (one.low[k] === null) { k++; continue; }
    let last = k;
    while (last + 1 < n && one.low[last + 1] !== null) last++;
    for (let i = k; i <= last; i++) path += `${i === k ? "M" : "L"}${X(one.t[i]).toFixed(1)} ${Y(one.high[i]).toFixed(1)}`;
    for (let i = last; i >= k; i--) path += `L${X(one.t[i]).toFixed(1)} ${Y(one.low[i]).toFixed(1)}`;
    path += "Z"; k = last + 1;
  }
  draw(parent, "path", { d: path, "stroke-width": 1, "stroke-linejoin": "round", ...attributes });
}
// Values that count: ignored stretches, such as the start, do not set the scale.
const counting = trail => {
  const kept = trail.t.map(t => t >= range.low && t <= range.high && !trail.left_out.some(([a, b]) => t >= a && t <= b));
  const of = name => trail[name].flatMap(one => one.filter((_, k) => kept[k]));
  return extent([of("before"), of("after")]);
};
function overTime(svg, trail) {
  let pointed = 0;
  const range_of = ([low, high], k) => low[k] === null ? "missing" : low[k] === high[k] ? few(low[k]) : `${few(low[k])} to ${few(high[k])}`;
  const words = k => {
    const rows = [`${trail.t[k].toFixed(3)} s, ${trail.axis} commanded ${num(trail.command[k], 3)} mm`, `before ${range_of(trail.before, k)} ${trail.unit}`];
    if (changed) rows.push(`after ${range_of(trail.after, k)} ${trail.unit}`);
    return rows.join("\n");
  };
  const paint = f => {
    trail.held_out.forEach(span => shade(f, ...span, HELD_OUT));
    const columns = f.box[2] - f.box[0];
    band(f.inside, merged(trail, "before", columns), f.X, f.Y, { ...BEFORE, "fill-opacity": 0.45, "stroke-opacity": 0.6 });
    if (changed) band(f.inside, merged(trail, "after", columns), f.X, f.Y, AFTER);
    trail.left_out.forEach(span => shade(f, ...span, { fill: "var(--paper)", opacity: 0.8 }));
    if (trail.noise) for (const y of [trail.noise, -trail.noise]) level(f, y, NOISE);
  };
  const now = chart(svg, range, 220, "t [s]", `log − model [${trail.unit}]`, () => counting(trail), paint, {
    hover: (t, x, y, e) => { pointed = at(trail.t, Math.min(Math.max(t, range.low), range.high)); show(e.clientX, e.clientY, words(pointed)); },
    step: sign => {
      pointed = at(trail.t, Math.min(Math.max(trail.t[pointed] + sign * 0.01 * (range.high - range.low), range.low), range.high));
      const r = svg.getBoundingClientRect();
      show(r.left + now().X(trail.t[pointed]), r.top + 30, words(pointed));
    },
  });
}
if (D.trails.length) {
  const s = section("Residuals, log − model");
  const bar = el("div", undefined, "bar"), all = button("all", () => { range.reset(); redraw(); });
  all.className = "hand";
  bar.append(key("original machine file", "--a", 0.6));
  if (changed) bar.append(key("better machine file", "--b", 1));
  bar.append(key("held-out data", "--line", 0.4), key("noise", "--ink", 1, "thin"), all, el("span", HINT, "hand"));
  s.append(bar);
  for (const trail of D.trails) {
    const part = el("section"), [b, a] = trail.rms.held_out, [fb, fa] = trail.rms.fitted;
    part.append(el("h3", trail.name));
    const reached = changed ? `, then ${few(a)} ${trail.unit} (fitted: ${few(fb)}, then ${few(fa)} ${trail.unit})` : ` (fitted: ${few(fb)} ${trail.unit})`;
    part.append(el("p", `rms on held-out data: ${few(b)}${changed ? "" : " " + trail.unit}${reached}`, "dim"));
    overTime(picture(part, `${trail.name} over time`, "picture time"), trail);
    const pair = el("div", undefined, "pair");
    if (Object.keys(trail.position).length) {
      const svg = picture(pair, `by the position of ${trail.axis}, mean (solid: moving to +, dashed: moving to −)`, "");
      pictures.push(() => {
        const ways = Object.entries(trail.position), xs = extent(ways.map(([, one]) => one.x));
        const ys = extent(ways.flatMap(([, one]) => changed ? [one.before, one.after] : [one.before]));
        const f = frame(svg, 200, ...xs, ...ys, `${trail.axis} [mm]`, `[${trail.unit}]`);
        for (const [way, one] of ways) {
          const dash = way === "1" ? {} : { "stroke-dasharray": "6 4" };
          line(f.inside, one.x, one.before, f.X, f.Y, { stroke: "var(--a)", ...dash });
          if (changed) line(f.inside, one.x, one.after, f.X, f.Y, { stroke: "var(--b)", ...dash });
        }
      });
    }
    if (trail.reversal) {
      const svg = picture(pair, `by the time since ${trail.axis} reversed, rms`, ""), one = trail.reversal;
      pictures.push(() => {
        const xs = [0, one.x[one.x.length - 1]], top = Math.max(trail.noise || 0, ...one.before.map(v => v || 0), ...(changed ? one.after : []).map(v => v || 0)) || 1;
        const f = frame(svg, 200, ...xs, 0, 1.06 * top, "since the reversal [ms]", `[${trail.unit}]`);
        line(f.inside, one.x, one.before, f.X, f.Y, { stroke: "var(--a)" });
        if (changed) line(f.inside, one.x, one.after, f.X, f.Y, { stroke: "var(--b)" });
        if (trail.noise) level(f, trail.noise, NOISE);
      });
    }
    part.append(pair); s.append(part);
  }
}

// The log itself.
{
  const q = D.quality, s = section("The log");
  const ms = v => v === null ? "–" : few(1000 * v);
  s.append(el("p", `A sample every ${ms(q.period)} ms${q.jitter > 1e-3 * q.period ? `, up to ${ms(q.jitter)} ms off` : ""}; the first ${few(q.first * q.period)} s are ignored.`));
  if (q.channels.length) {
    const micro = (one, v) => v === null ? "–" : one.unit === "mm" ? `${few(1000 * v)} µm` : `${few(v)} ${one.unit}`;
    s.append(scroll(table(["channel", "noise", "noise from", "smallest step", "missing", "late, ms"], q.channels.map(one =>
      [`${one.axis}_${one.channel}`, micro(one, one.noise), one.noise_from, one.resolution ? micro(one, one.resolution) : "none seen", String(one.missing), ms(one.shift)]))));
  }
  list(s, [...q.faults, ...q.notes, ...D.warnings]);
}

everything();
