// A path or a program: its reversals, its predicted error magnified, its feed before and after.
const P = D.path, RUNS = D.runs, MARKS = D.points, COLOURS = ["--a", "--b"];
const NAMES = ["x", "y", "z"].slice(0, D.axes.length);
const seen = { runs: RUNS.map(() => true), windows: true, points: true };
const first = RUNS[0], last = RUNS[RUNS.length - 1], changed = RUNS.length > 1;

// The answer.
{
  main.append(el("h1", D.summary));
  const facts = [`machine ${D.machine.name}`, `${num(D.length, 3)} mm`, changed ? `strategy ${D.strategy}` : "nothing changed", `ph-post ${D.version}`];
  main.append(el("p", facts.join(" · "), "dim"));
  const tiles = el("div", undefined, "tiles");
  // Values of runs have the colours of these.
  const tile = (title, values, below, tags = ["i", "em"]) => {
    const t = el("div", undefined, "tile"), b = el("b");
    values.forEach((v, k) => { if (k) b.append(" → "); b.append(el(tags[k], v)); });
    t.append(title, b, el("span", below, "dim")); tiles.append(t);
  };
  const R = D.result;
  const gain = (a, b) => !a || !b ? "" : Math.abs(a / b - 1) < 0.005 ? "as before" : a >= b ? `${few(a / b)} times smaller` : `${few(b / a)} times larger`;
  // What backlash causes, as the headline has it; below it what the part shows by all causes.
  const sizes = (title, own, of) => {
    const all = RUNS.map(of), found = own || all, words = all.map(micrometres).join(" → ");
    tile(title, (changed ? found : found.slice(-1)).map(micrometres), own ? `all causes: ${words}` : gain(...found));
  };
  const both = name => R.before && R.after ? [R.before[name], R.after[name]] : null;
  const what = R.before && R.after ? "Backlash error" : "Contour error";
  sizes(`${what}, largest, µm`, both("max"), one => one.error && 1000 * one.error.max);
  sizes(`${what}, rms, µm`, both("rms"), one => one.error && 1000 * one.error.rms);
  if (R.worst !== null && R.spread) tile(`Backlash ${R.spread} off, µm`, [micrometres(R.worst)], "largest error then", [changed ? "em" : "i"]);
  else sizes("Worst case, µm", null, one => one.worst && 1000 * one.worst.max);
  const more = changed && first.time ? 100 * (last.time / first.time - 1) : null;
  tile("Cycle time, s", RUNS.map(one => num(one.time, 3)), more === null ? "" : Math.abs(more) < 0.005 ? "as before" : `${num(Math.abs(more))} % ${more < 0 ? "less" : "more"}`);
  const done = R.reversals;
  tile("Reversals compensated", [done ? `${done.compensated} of ${done.all}` : "–"], R.axes.length ? R.axes.join(", ") : "no axis", ["span"]);
  main.append(tiles);
  D.warnings.forEach(text => main.append(el("p", text, "note")));
}

// The place that is pointed at: a row of a run, and a reversal that is lit.
const range = new Range(0, D.length);
let pointed = null, lit = null;
// Round, so that the largest error is a twentieth of the path.
const mag = magnifier("error", Math.max(...NAMES.map(n => { const [a, b] = extent([P[n]], 0); return b - a; })),
  Math.max(...RUNS.map(run => Math.max(0, ...run.e.map((e, k) => run.counted[k] ? Math.abs(e) / 1000 : 0)))));
const views = NAMES.length < 2 ? [[0, 1]] : NAMES.flatMap((_, a) => NAMES.slice(a + 1).map((_, b) => [a, a + 1 + b]));
const viewName = ([a, b]) => `${D.axes[a]}${D.axes[b] || ""}`;
let view = views[0];
const nothing = () => 0;
const column = (from, names, k) => { const values = from[names[k]]; return values ? i => values[i] : nothing; };
const DNAMES = NAMES.map(n => `d${n}`);
const placed = run => view.map(k => { const foot = column(run, NAMES, k), away = column(run, DNAMES, k); return i => foot(i) + mag.factor * away(i); });
// Where a run is drawn in one direction of the view, between two places along the path.
const reached = (run, n, low = -Infinity, high = Infinity) => {
  const place = placed(run)[n];
  return run.s.map((s, i) => run.counted[i] && s >= low && s <= high ? place(i) : null);
};
const markAt = s => {
  let best = null;
  MARKS.forEach((p, k) => { if (p.window && s >= p.window[0] - 1e-9 && s <= p.window[1] + 1e-9 && (best === null || Math.abs(p.s - s) < Math.abs(MARKS[best].s - s))) best = k; });
  return best;
};
const near = (run, s) => {
  let k = at(run.s, s);
  if (k + 1 < run.s.length && Math.abs(run.s[k + 1] - s) < Math.abs(run.s[k] - s)) k += 1;
  return k;
};
const sideWord = e => D.axes.length !== 2 || D.kind !== "path" ? "" : e > 0 ? " left" : e < 0 ? " right" : "";
function words(run, k) {
  const rows = [`s ${num(run.s[k], 3)} mm   ` + NAMES.map((n, i) => `${D.axes[i]} ${num(run[n][k], 4)}`).join("  ") + (run.line ? `   line ${run.line[k]}` : "")];
  RUNS.forEach((one, r) => {
    if (!seen.runs[r]) return;
    const i = one === run ? k : near(one, run.s[k]);
    const error = one.counted[i] ? `error ${micrometres(Math.abs(one.e[i]))} µm${sideWord(one.e[i])}` : "error not counted here";
    rows.push(`${one.name}: ${error}, ${one.feed[i] === null ? "feed not known" : `feed ${num(one.feed[i], 1)} mm/min`}, at ${num(one.t[i], 3)} s`);
  });
  const m = markAt(run.s[k]);
  if (m !== null) rows.push(`in the window of #${MARKS[m].index} (${MARKS[m].axis} ${MARKS[m].sense}): ${MARKS[m].done}`);
  return rows.join("\n");
}
function point(run, k, x, y) {
  pointed = run === null ? null : { run, k };
  light(run === null ? null : markAt(run.s[k]));
  overlays.forEach(one => one());
  if (run === null) show(); else show(x, y, words(run, k));
}
function walk(svg, sign) {
  const from = pointed || { run: RUNS.find((_, r) => seen.runs[r]) || first, k: near(first, range.low) };
  const wanted = from.run.s[from.k] + sign * 0.01 * (range.high - range.low);
  let k = near(from.run, wanted);
  if (k === from.k) k = Math.min(Math.max(k + sign, 0), from.run.s.length - 1);
  const r = svg.getBoundingClientRect();
  point(from.run, k, r.left + r.width / 2, r.top + 40);
}

const desk = el("div", undefined, "desk"), left = el("div"), right = el("div");
const overlays = [];
let flat = null;
{
  const s = section(changed ? "Programmed and executed path, before and after" : "Programmed and executed path");
  const bar = el("div", undefined, "bar hand");
  RUNS.forEach((run, r) => { bar.append(button(run.name, b => { seen.runs[r] = !seen.runs[r]; b.setAttribute("aria-pressed", seen.runs[r]); redraw(); }, true)); });
  for (const [name, text] of [...(D.windowed ? [["windows", "windows"]] : []), ["points", "reversals"]])
    bar.append(button(text, b => { seen[name] = !seen[name]; b.setAttribute("aria-pressed", seen[name]); redraw(); }, true));
  bar.append(mag.box);
  if (views.length > 1) bar.append(choice(views.map(viewName), viewName(view), name => { view = views.find(one => viewName(one) === name); flat.whole = true; flat.fit(); redraw(); }));
  bar.append(button("all", () => { range.reset(); flat.whole = true; flat.fit(); redraw(); }));
  s.append(bar);
  const legend = el("div", undefined, "bar");
  legend.append(key("path", "--dim"));
  if (P.rapid.length) legend.append(key("rapid", "--dim", 1, "thin"));
  RUNS.forEach((run, r) => legend.append(key(`${run.name}, error magnified`, COLOURS[r])));
  if (MARKS.some(p => p.window)) legend.append(key("window", "--window"));
  if (MARKS.length) legend.append(key("reversal: an axis turns back", "--point", 1, "dot"));
  legend.append(el("span", "▶ start of the cut"));
  s.append(legend, el("p", `${HINT}; arrows walk along the path`, "dim hand"), desk);
  desk.append(left, right);
}

// The plane.
{
  const svg = picture(left, "the path, and the error magnified, normal to it", "picture plane", false);
  svg.id = "plane";
  // Framed on what is cut: a way to it from far away would make the part a dot.
  const cut = k => rapid[k] !== 1 && rapid[k] !== 2 && k > 0;
  const shown = name => { const found = P[name].filter((_, k) => cut(k) || k + 1 < P.s.length && cut(k + 1)); return found.length ? found : P[name]; };
  const bounds = () => view.map((k, n) => extent([NAMES[k] ? shown(NAMES[k]) : [0], ...RUNS.filter((_, r) => seen.runs[r]).map(run => reached(run, n))], 0));
  const tall = width => Math.round(Math.min(Math.max(0.75 * width, 300), 620));
  const within = s => s >= range.low && s <= range.high;
  const span = ([a, b]) => P.closed && a < 0 ? [[0, b], [D.length + a, D.length]] : P.closed && b > D.length ? [[a, D.length], [0, b - D.length]] : [[a, b]];
  const stretch = (v, [a, b], attributes, parent = v.inside) => {
    const [u, w] = view.map(k => column(P, NAMES, k)), from = at(P.s, a), to = at(P.s, b);
    const d = strokes(to - from + 1, k => v.X(u(from + k)), k => v.Y(w(from + k)), () => true, v.box);
    draw(parent, "path", { ...LINE, "stroke-linecap": "round", d, ...attributes });
  };
  const bands = (v, p, attributes, parent) => span(p.window).forEach(part => stretch(v, part, attributes, parent));
  // Places are rounded to five decimals.
  const NEAR = 1e-5;
  // Whether the step that ends in a point is a rapid move.
  const rapid = new Uint8Array(P.s.length);
  P.rapid.forEach(([a, b]) => { for (let k = at(P.s, a + NEAR) + 1; k < P.s.length && P.s[k] <= b + NEAR; k++) rapid[k] = 1; });
  // Nothing is drawn where the place of the axes is not known.
  P.unknown.forEach(([a, b]) => { for (let k = at(P.s, a + NEAR) + 1; k < P.s.length && P.s[k] <= b + NEAR; k++) rapid[k] = 2; });
  let v = null, over = null;
  const paint = now => {
    v = now;
    if (seen.windows) MARKS.forEach(p => { if (p.window) bands(v, p, { stroke: "var(--window)", "stroke-width": 9, opacity: 0.55, class: "window" }); });
    const [pu, pw] = view.map(k => column(P, NAMES, k));
    for (const kind of [1, 0]) {
      const d = steps(P.s.length, k => v.X(pu(k)), k => v.Y(pw(k)), k => rapid[k] === kind, v.box);
      draw(v.inside, "path", { ...LINE, d, stroke: "var(--dim)", "stroke-width": kind ? 0.7 : 1, ...(kind ? DASHES : {}), class: "path" });
    }
    RUNS.forEach((run, r) => {
      if (!seen.runs[r]) return;
      const [x, y] = placed(run);
      for (const inside of [false, true]) {
        if (!inside && range.low <= 0 && range.high >= D.length) continue;
        const d = strokes(run.s.length, k => v.X(x(k)), k => v.Y(y(k)), k => run.counted[k] && within(run.s[k]) === inside, v.box);
        draw(v.inside, "path", { ...LINE, d, stroke: `var(${COLOURS[r]})`, opacity: inside ? 1 : 0.25, class: `run run${r}` });
      }
      const [u, w] = view.map(k => column(run, NAMES, k));
      stretches(run.s.length, k => run.counted[k]).forEach(({ from, to, said }) => {
        if (!said) return;
        // A cut that stays on its place in this view is a hole; the place nearest to it may lie on the rapid before.
        for (let k = from; k < to; k++) if (Math.hypot(u(k) - u(to), w(k) - w(to)) > 0.3) return;
        draw(v.inside, "circle", { cx: v.X(x(to)), cy: v.Y(y(to)), r: 3, fill: `var(${COLOURS[r]})`, class: `hole run${r}` });
      });
    });
    if (seen.points) numbers(v);
    start(v, pu, pw); ruler(v, "error", "µm", v.scale * mag.factor / 1000);
    over = draw(v.inside, "g", {}); overlay();
  };
  // The reversals over their numbers; where some are too close to each other, the first number is shown.
  function numbers(v) {
    const taken = [], places = MARKS.map(p => [v.X(p.at[view[0]] || 0), v.Y(p.at[view[1]] || 0)]);
    places.forEach(([px, py], k) => {
      const text = `#${MARKS[k].index}`, x = px + 7, y = py - 6;
      if (x < 0 || y < 0 || x > v.width || y > v.height || taken.some(([a, b]) => Math.abs(a - x) < 6 + 8 * text.length && Math.abs(b - y) < 14)) return;
      taken.push([x, y]); draw(v.inside, "text", { x, y, class: "ink" }, text);
    });
    places.forEach(([cx, cy]) => draw(v.inside, "circle", { cx, cy, r: 3.4, fill: "var(--card)", stroke: "var(--point)", "stroke-width": 1.8, class: "point" }));
  }
  // Start and direction of the motion.
  function start(v, u, w) {
    if (P.s.length < 2) return;
    let begin = P.s.findIndex((_, k) => k + 1 < P.s.length && cut(k + 1));
    // In this view the cut begins where the tool is down.
    const still = k => Math.hypot(u(k) - u(begin), w(k) - w(begin)) < 1e-9;
    if (begin < 0) begin = 0;
    const x = v.X(u(begin)), y = v.Y(w(begin));
    let k = begin + 1;
    while (k + 1 < P.s.length && still(k)) k++;
    while (k + 1 < P.s.length && Math.hypot(v.X(u(k)) - x, v.Y(w(k)) - y) < 4) k++;
    const turn = Math.atan2(v.Y(w(k)) - y, v.X(u(k)) - x) * 180 / Math.PI;
    draw(v.inside, "path", { d: "M0 -5L11 0L0 5Z", transform: `translate(${x.toFixed(1)} ${y.toFixed(1)}) rotate(${turn.toFixed(1)})`, fill: "var(--ink)" });
  }
  const overlay = () => {
    if (!over) return;
    over.textContent = "";
    if (lit !== null && MARKS[lit].window) bands(v, MARKS[lit], { stroke: "var(--point)", "stroke-width": 14, opacity: 0.28, class: "lit" }, over);
    if (lit !== null) { const [x, y] = view.map(k => MARKS[lit].at[k] || 0); draw(over, "circle", { cx: v.X(x), cy: v.Y(y), r: 8, fill: "none", stroke: "var(--point)", "stroke-width": 2 }); }
    if (!pointed) return;
    RUNS.forEach((run, r) => {
      if (!seen.runs[r]) return;
      const k = run === pointed.run ? pointed.k : near(run, pointed.run.s[pointed.k]), [x, y] = placed(run), [fx, fy] = view.map(n => column(run, NAMES, n)(k));
      draw(over, "line", { x1: v.X(fx), y1: v.Y(fy), x2: v.X(x(k)), y2: v.Y(y(k)), stroke: `var(${COLOURS[r]})`, "stroke-width": 1.2 });
      draw(over, "circle", { cx: v.X(x(k)), cy: v.Y(y(k)), r: 4.5, fill: `var(${COLOURS[r]})`, stroke: "var(--card)", "stroke-width": 1.5 });
    });
  };
  overlays.push(overlay);
  flat = plane(svg, tall, () => [`${D.axes[view[0]]} [mm]`, D.axes[view[1]] ? `${D.axes[view[1]]} [mm]` : ""], bounds, paint, {
    hover: (x, y, e) => {
      let best = 40, run = null, row = 0;
      RUNS.forEach((one, r) => {
        if (!seen.runs[r]) return;
        const [u, w] = placed(one), [fu, fw] = view.map(n => column(one, NAMES, n));
        for (let k = 0; k < one.s.length; k++) {
          // The place on the path counts too: of a large error one may point at either.
          const d = Math.min(Math.hypot(v.X(u(k)) - x, v.Y(w(k)) - y), 0.5 + Math.hypot(v.X(fu(k)) - x, v.Y(fw(k)) - y));
          if (d < best) { best = d; run = one; row = k; }
        }
      });
      point(run, row, e.clientX, e.clientY);
    },
    leave: () => point(null), step: sign => walk(svg, sign), reset: () => range.reset(),
  });
}

// Error and feed along the path.
{
  const ground = f => {
    [...P.rapid, ...P.unknown].forEach(([a, b]) => shade(f, a, b, { fill: "var(--shade)" }));
    // Where they stand closer than a few pixels they would hide everything else.
    const sparse = seen.points && MARKS.filter(p => p.s >= range.low && p.s <= range.high).length < f.width / 8;
    MARKS.forEach(p => {
      if (seen.windows && p.window) shade(f, ...p.window, { fill: "var(--window)", opacity: 0.3, class: "window" });
      if (sparse && p.s >= range.low && p.s <= range.high) upright(f, p.s, { stroke: "var(--point)", "stroke-width": 0.8, "stroke-dasharray": "2 3" });
    });
  };
  const visible = (run, of) => run.s.map((s, k) => s >= range.low && s <= range.high ? of(run, k) : null);
  const error = (run, k) => run.counted[k] ? run.e[k] : null, feed = (run, k) => run.feed[k];
  const kinds = [
    ["error", `contour error along the path${D.axes.length === 2 && D.kind === "path" ? ", + left of it" : ""}`, "[µm]", error, 240, low => low],
    ["feed", "feed along the path", "[mm/min]", feed, 220, (low) => Math.min(low, 0)],
  ];
  for (const [id, label, unit, of, height, floor] of kinds) {
    const svg = picture(right, label, "picture");
    svg.id = id;
    let f = null, over = null;
    const ys = () => { const [low, high] = extent(RUNS.flatMap((run, r) => seen.runs[r] ? [visible(run, of)] : [])); return [floor(low), high]; };
    const overlay = () => {
      if (!over) return;
      over.textContent = "";
      if (lit !== null) { const p = MARKS[lit]; shade(f, ...(p.window || [p.s, p.s]), { fill: "var(--point)", stroke: "var(--point)", opacity: 0.16, class: "lit" }, over); }
      if (!pointed) return;
      const s = pointed.run.s[pointed.k];
      upright(f, s, {}, over);
      RUNS.forEach((run, r) => {
        if (!seen.runs[r]) return;
        const k = run === pointed.run ? pointed.k : near(run, s), y = of(run, k);
        if (y !== null) draw(over, "circle", { cx: f.X(run.s[k]), cy: f.Y(y), r: 4, fill: `var(${COLOURS[r]})`, stroke: "var(--card)", "stroke-width": 1.5 });
      });
    };
    overlays.push(overlay);
    chart(svg, range, height, "s [mm]", unit, ys, now => {
      f = now;
      ground(f);
      RUNS.forEach((run, r) => {
        if (!seen.runs[r]) return;
        const d = strokes(run.s.length, k => f.X(run.s[k]), k => f.Y(of(run, k)), k => of(run, k) !== null, f.lane);
        draw(f.inside, "path", { ...LINE, d, stroke: `var(${COLOURS[r]})`, class: `run run${r}` });
      });
      over = draw(f.inside, "g", {}); overlay();
    }, {
      hover: (s, x, y, e) => {
        let best = Infinity, run = null, row = 0;
        RUNS.forEach((one, r) => {
          if (!seen.runs[r]) return;
          const k = near(one, s), value = of(one, k), d = value === null ? 1e6 : Math.abs(f.Y(value) - y);
          if (d < best) { best = d; run = one; row = k; }
        });
        point(run, row, e.clientX, e.clientY);
      },
      leave: () => point(null), step: sign => walk(svg, sign),
    });
  }
}

// The reversals, a row each.
const rows = [];
function light(k) {
  if (k === lit) return;
  if (lit !== null && rows[lit]) rows[lit].classList.remove("lit");
  lit = k;
  if (k !== null && rows[k]) rows[k].classList.add("lit");
}
function goTo(p) {
  const [a, b] = p.window || [p.s - 0.01 * D.length, p.s + 0.01 * D.length], more = Math.max(0.6 * (b - a), 1e-4);
  range.set(a - more, b + more);
  const from = at(P.s, range.low), to = at(P.s, range.high);
  flat.whole = false;
  flat.fit(view.map((k, n) => extent([[p.at[k] || 0], ...RUNS.map(run => reached(run, n, a, b)), NAMES[k] ? P[NAMES[k]].slice(from, to + 1) : [0]], 0)), 0.8);
  redraw();
  desk.scrollIntoView({ block: "nearest" });
}
{
  const s = section("Reversals");
  if (!MARKS.length) s.append(el("p", "No axis reverses on this path: backlash leaves no mark on it."));
  const bound = { deviation: "leaves its circle", neighbour: "its neighbour", end: "the path's end", corner: "a corner" };
  const errors = p => p.errors.map(micrometres).join(" → ");
  const told = p => p.strategy === "none" || D.windowed || p.strategy === "compensated before" ? p.done : "compensated";
  const columns = [
    ["#", p => `#${p.index}`, p => p.index],
    ...(D.kind === "program" ? [["line", p => String(p.line), p => p.line]] : []),
    ["s mm", p => num(p.s, 3), p => p.s],
    ...D.axes.map((name, k) => [`${name} mm`, p => num(p.at[k], 3), p => p.at[k]]),
    ["reversal", p => D.windowed ? `${p.axis} ${p.sense}, ${p.kind}` : `${p.axis} ${p.sense}`, p => p.axis + p.sense],
    ...(D.windowed ? [
      ["window ± mm", p => num(p.half, 3), p => p.half],
      ["limited by", p => p.limited_by === null ? "–" : bound[p.limited_by] || p.limited_by, p => p.limited_by],
      ["lag ms", p => num(p.lag, 2), p => p.lag],
      ["standstill ms", p => num(p.duration, 2), p => p.duration],
      ["strategy", told, p => p.strategy],
      ["feed × ", p => p.ratio === null ? "–" : num(p.ratio, 2), p => p.ratio],
    ] : [["what is done", told, p => p.strategy]]),
    ["error µm", errors, p => p.errors[0]],
    ...(MARKS.some(p => p.notes.length) ? [["notes", p => p.notes.join("; "), p => p.notes.join()]] : []),
  ];
  const wordy = columns.map(([name], n) => name === "notes" ? n : -1).filter(n => n >= 0), most = 300;
  const t = table(columns.map(() => ""), []), head = t.querySelectorAll("th"), body = t.querySelector("tbody");
  let order = MARKS.map((_, k) => k), shown = most;
  columns.forEach(([name, , of], n) => {
    if (wordy.includes(n)) head[n].className = "words";
    head[n].append(button(name, () => {
      const down = head[n].getAttribute("aria-sort") === "ascending";
      head.forEach(one => one.removeAttribute("aria-sort"));
      head[n].setAttribute("aria-sort", down ? "descending" : "ascending");
      const rank = v => v === null || v === undefined ? -Infinity : v;
      order.sort((a, b) => { const x = rank(of(MARKS[a])), y = rank(of(MARKS[b])); return (x < y ? -1 : x > y ? 1 : a - b) * (down ? -1 : 1); });
      fill();
    }));
  });
  head[0].setAttribute("aria-sort", "ascending");
  const more = button("show all", () => { shown = Infinity; fill(); });
  more.className = "more hand";
  function fill() {
    body.textContent = "";
    order.slice(0, shown).forEach(k => {
      const p = MARKS[k], r = el("tr");
      columns.forEach(([, cell], n) => r.append(el("td", cell(p), wordy.includes(n) ? "words" : "")));
      leads(r, () => goTo(p)); r.dataset.index = p.index;
      const on = () => { light(k); overlays.forEach(one => one()); }, off = () => { light(null); overlays.forEach(one => one()); };
      r.onmouseenter = r.onfocus = on; r.onmouseleave = r.onblur = off;
      rows[k] = r; body.append(r);
    });
    more.hidden = order.length <= shown;
  }
  if (MARKS.length) {
    fill();
    s.append(el("p", `Pointing at a row highlights its ${D.windowed ? "window" : "place"}; a click or Enter zooms to it.`, "dim hand"));
    if (D.windowed) s.append(el("p", "Lag: delay of the axis behind the commanded reversal; standstill: time that it then stands still in the steady state, uncompensated.", "dim"));
    s.append(scroll(t), more);
  }
}

// The machine, and how the numbers are computed.
const foot = el("div", undefined, "pair");
{
  const M = D.machine, s = section(`The machine: ${M.name}`);
  main.append(foot); foot.append(s);
  s.append(el("p", `controller ${M.dialect}, servo period ${M.period} ms`, "dim"), scroll(table(["", ...M.axes], M.rows)));
  if (M.effects.length) s.append(el("h3", "Effects"), table(["axis", "effect", "parameters"], M.effects.map(one => [one.axis, one.name, Object.entries(one.parameters).map(([k, v]) => `${k} = ${v}`).join(", ")]), [1, 2]));
  else s.append(el("p", "No further effects: servo and backlash only."));
}
{
  const s = section("How the numbers are computed");
  foot.append(s);
  list(s, [
    ...RUNS.map(run => `${run.name}: simulated with ${run.assumed}; worst case: ${run.worst_words || "the same"}; ${run.samples} samples`),
    "The error is the distance from the executed position to the nearest point of the path, after five servo time constants" + (D.kind === "program" ? ", while the tool cuts." : "."),
    ...D.notes,
  ]);
}
everything();
