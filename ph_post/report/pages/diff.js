// Two programs: the tool path of the first, of the second where it differs, and the other differences.
const P = D.path, OFF = D.off, COLOURS = ["--a", "--b"], NAMES = ["x", "y", "z"];
const span = r => r === null ? "–" : r[0] === r[1] ? `${r[0]}` : `${r[0]}–${r[1]}`;
const most = D.geometry.max_deviation || 0;
const VIEWS = { XY: [0, 1], XZ: [0, 2], YZ: [1, 2] };
// The last place is rounded, and may lie a little behind the end.
const range = new Range(0, Math.max(D.files[0].length, ...P.s.slice(-1)));
const mag = magnifier("deviations", Math.max(...NAMES.map(n => { const [a, b] = extent([P[n]], 0); return b - a; })), most);
let view = "XY", flat = null, pointed = null;
const overlays = [];
const unpoint = () => { pointed = null; overlays.forEach(one => one()); };

// What stands above the pictures.
main.append(el("h1", D.summary.join(" · ")));
{
  const [a, b] = D.files, T = D.time, E = D.error;
  const rows = [["file", a.name, b.name], ["lines", a.lines, b.lines], ["motions", a.motions, b.motions],
    ["path mm", num(a.length, 3), num(b.length, 3)], ["time s", num(T.a.total, 3), num(T.b.total, 3)]];
  if (E) rows.unshift(["predicted error µm", ...[E.a, E.b].map(e => e ? `${micrometres(1000 * e.max)} (rms ${micrometres(1000 * e.rms)})` : "–")]);
  main.append(scroll(table(["", "A", "B"], rows)));
  const declared = [...a.declares.map(t => "A: " + t), ...b.declares.map(t => "B: " + t)];
  if (declared.length) main.append(el("pre", declared.join("\n")));
}

// The path in one of three views, and charts along it.
// B is drawn off A with its deviation magnified; A is drawn in place.
const moved = (o, k) => VIEWS[view].map(n => o[NAMES[n]][k] + (o === OFF[1] ? mag.factor : 1) * o[`d${NAMES[n]}`][k]);
const bounds = () => VIEWS[view].map(n => extent([P[NAMES[n]], ...OFF.map(o => o[NAMES[n]].map((v, k) => v + o[`d${NAMES[n]}`][k]))], 0));
const away = (o, k) => Math.hypot(o.dx[k], o.dy[k], o.dz[k]);
const zoomTo = one => {
  const k = VIEWS[view], reach = 4 * Math.max(one.deviation * mag.factor, 1e-3);
  flat.whole = false; flat.fit(k.map(n => [one.position[n] - reach, one.position[n] + reach]));
  const more = Math.max(one.s_a[1] - one.s_a[0], 1e-3);
  range.set(one.s_a[0] - more, one.s_a[1] + more);
  redraw(); $("path").scrollIntoView({ block: "nearest" });
};
{
  const s = section("Tool path"), bar = el("div", undefined, "bar hand");
  bar.append(choice(Object.keys(VIEWS), view, name => { view = name; flat.whole = true; flat.fit(); redraw(); }), mag.box,
    button("all", () => { range.reset(); flat.whole = true; flat.fit(); redraw(); }));
  const legend = el("div", undefined, "bar");
  legend.append(key("A", "--a"), key("A where B differs", "--a", 0.25), key("B where it differs, magnified", "--b"), key("rapid", "--dim", 1, "thin"));
  s.append(bar, legend, el("p", HINT, "dim hand"));
  const svg = picture(s, "the tool path of A, and of B where it differs", "picture plane", false);
  svg.id = "path";
  let v = null, over = null;
  const overlay = () => {
    if (!over) return;
    over.textContent = "";
    if (pointed) { const [x, y] = pointed.at(); draw(over, "circle", { cx: v.X(x), cy: v.Y(y), r: 5, fill: "none", stroke: "var(--ink)", "stroke-width": 2 }); }
  };
  overlays.push(overlay);
  const paint = now => {
    v = now;
    const [u, w] = VIEWS[view].map(n => P[NAMES[n]]), inside = k => P.s[k] >= range.low && P.s[k] <= range.high;
    const off = (side, look) => {
      const o = OFF[side], places = o.x.map((_, k) => moved(o, k));
      for (const rapid of [1, 0]) {
        const d = steps(places.length, k => v.X(places[k][0]), k => v.Y(places[k][1]), k => o.rapid[k] === rapid && o.stretch[k] === o.stretch[k - 1], v.box);
        draw(v.inside, "path", { ...LINE, d, stroke: `var(${COLOURS[side]})`, ...look(rapid), class: `off${side}` });
      }
    };
    if (OFF.length) off(0, () => ({ "stroke-width": 7, opacity: 0.25 }));
    for (const rapid of [1, 0]) for (const lit of [false, true]) {
      const d = steps(P.x.length, k => v.X(u[k]), k => v.Y(w[k]), k => P.rapid[k] === rapid && inside(k) === lit, v.box);
      const look = rapid ? { stroke: "var(--dim)", "stroke-width": 0.8, ...DASHES } : { stroke: "var(--a)", "stroke-width": 1.5 };
      draw(v.inside, "path", { ...LINE, d, opacity: lit ? 1 : 0.35, ...look, class: "path" });
    }
    if (OFF.length) off(1, rapid => rapid ? { "stroke-width": 1, ...DASHES } : { "stroke-width": 1.8 });
    if (most) ruler(v, "deviation", "µm", v.scale * mag.factor / 1000);
    over = draw(v.inside, "g", {}); overlay();
  };
  flat = plane(svg, width => Math.round(Math.min(Math.max(0.5 * width, 320), 560)), () => [...view].map(n => `${n} [mm]`), bounds, paint, {
    hover: (x, y, e) => {
      let best = 14, text = "";
      pointed = null;
      const [u, w] = VIEWS[view].map(n => P[NAMES[n]]);
      for (let k = 0; k < P.x.length; k++) {
        const d = Math.hypot(v.X(u[k]) - x, v.Y(w[k]) - y);
        if (d < best) { best = d; pointed = { s: P.s[k], at: () => [u[k], w[k]] }; text = `A line ${P.line[k]}${P.rapid[k] ? ", rapid" : ""}, s ${num(P.s[k], 3)} mm\nX ${P.x[k]}  Y ${P.y[k]}  Z ${P.z[k]}`; }
      }
      OFF.forEach((o, side) => {
        for (let k = 0; k < o.x.length; k++) {
          const [p, q] = moved(o, k), d = Math.hypot(v.X(p) - x, v.Y(q) - y);
          if (d < best) { best = d; pointed = { s: o.s[k], at: () => moved(o, k) }; text = `${side ? "B" : "A"} line ${o.line[k]}\noff by ${micrometres(1000 * away(o, k))} µm`; }
        }
      });
      overlays.forEach(one => one()); show(e.clientX, e.clientY, text);
    },
    leave: unpoint, reset: () => range.reset(),
  });
}
{
  const feedAt = (p, s) => p.s.length < 2 || s < p.s[0] || s > p.s[p.s.length - 1] ? undefined : p.feed[Math.min(at(p.s, s), p.feed.length - 1)];
  const place = s => {
    const k = at(P.s, s);
    pointed = P.x.length ? { s, at: () => VIEWS[view].map(n => P[NAMES[n]][k]) } : { s, at: () => [NaN, NaN] };
    overlays.forEach(one => one());
    const rows = [`s ${num(s, 3)} mm`];
    D.speed.forEach((p, n) => { const f = feedAt(p, s); rows.push(`${"AB"[n]} ${f === undefined || f === null ? "rapid, or no feed" : `F ${f}`}`); });
    OFF.forEach((o, side) => {
      let best = null;
      for (let i = 0; i < o.s.length; i++) if (best === null || Math.abs(o.s[i] - s) < Math.abs(o.s[best] - s)) best = i;
      if (best !== null && Math.abs(o.s[best] - s) < 0.01 * (range.high - range.low)) rows.push(`${"AB"[side]} off by ${micrometres(1000 * away(o, best))} µm`);
    });
    return rows.join("\n");
  };
  const charts = [
    ["dev", "Deviation along A", "[µm]", () => [0, 1000 * Math.max(most * 1.05, 1e-6)], f => OFF.forEach((o, side) => {
      const d = steps(o.s.length, k => f.X(o.s[k]), k => f.Y(1000 * away(o, k)), k => o.stretch[k] === o.stretch[k - 1], f.lane);
      draw(f.inside, "path", { ...LINE, d, stroke: `var(${COLOURS[side]})` });
    })],
    ["feed", "Programmed feed along A", "[mm/min]", () => [0, 1.05 * D.speed.reduce((m, p) => p.feed.reduce((n, f) => Math.max(n, f || 0), m), 1e-6)], f => D.speed.forEach((p, side) => {
      const n = 2 * p.feed.length, value = i => p.feed[i >> 1];
      const d = strokes(n, i => f.X(p.s[(i + 1) >> 1]), i => f.Y(value(i)), i => value(i) !== null, f.lane);
      draw(f.inside, "path", { ...LINE, d, stroke: `var(${COLOURS[side]})`, ...(side ? {} : { "stroke-width": 2.4, opacity: 0.75 }) });
    })],
  ];
  for (const [id, title, unit, ys, paint] of charts) {
    const s = section(`${title} ${unit}`), svg = picture(s, title, "picture", false);
    svg.id = id;
    let f = null, over = null;
    overlays.push(() => {
      if (!over) return;
      over.textContent = "";
      if (pointed) upright(f, pointed.s, {}, over);
    });
    chart(svg, range, 190, "s [mm]", "", ys, now => { f = now; paint(f); over = draw(f.inside, "g", {}); }, {
      hover: (x, px, py, e) => show(e.clientX, e.clientY, place(Math.min(Math.max(x, range.low), range.high))),
      leave: unpoint,
      step: sign => {
        const x = Math.min(Math.max((pointed ? pointed.s : range.low) + sign * 0.01 * (range.high - range.low), range.low), range.high), r = svg.getBoundingClientRect();
        show(r.left + f.X(x), r.top + 30, place(x));
      },
    });
  }
}

// What stands below them.
{
  const add = (title, t) => section(title).append(scroll(t));
  const devs = D.geometry.stretches, T = D.time;
  if (devs.length) {
    const t = table(["lines of A", "lines of B", "from s", "to s", "deviation µm", "at line", "X", "Y", "Z"],
      devs.map(d => [span(d.a), span(d.b), num(d.s_a[0], 3), num(d.s_a[1], 3), micrometres(1000 * d.deviation), `${d.where.on.toUpperCase()}:${d.where.line}`, ...d.position.map(x => num(x, 3))]));
    [...t.tBodies[0].rows].forEach((r, k) => leads(r, () => zoomTo(devs[k])));
    add("Where the tool path deviates", t);
  }
  const feeds = (r, n) => r === null ? "–" : r[0] === r[1] ? num(r[0], n) : `${num(r[0], n)} to ${num(r[1], n)}`;
  if (D.feed.stretches.length) add("Where the feed differs (mm/min)", table(["lines of A", "lines of B", "from s", "to s", "A", "B", "ratio"],
    D.feed.stretches.map(f => [span(f.a), span(f.b), num(f.s_a[0], 3), num(f.s_a[1], 3), feeds(f.feed_a, 1), feeds(f.feed_b, 1), feeds(f.ratio, 4)])));
  if (T.stretches.length) add("Where the time differs (s)", table(["lines of A", "lines of B", "A", "B", "B − A"],
    T.stretches.map(t => [span(t.a), span(t.b), num(t.time_a, 3), num(t.time_b, 3), num(t.time_b - t.time_a, 3)])));
  if (D.orders.length) add("Other commands", table(["what", "line of A", "line of B"], D.orders.map(o => [o.what, o.a ?? "–", o.b ?? "–"])));
  if (D.notes.length) add("Compared as text", table([""], D.notes.map(n => [n])));
  const s = section("Blocks"), shown = 500;
  D.blocks.slice(0, shown).forEach(h => {
    const d = el("div", undefined, "change"), p = el("pre");
    d.append(el("b", `${h.kind}: ${span(h.a)} | ${span(h.b)}`));
    h.text_a.slice(0, 200).forEach(t => p.append(el("div", "- " + t, "gone")));
    h.text_b.slice(0, 200).forEach(t => p.append(el("div", "+ " + t, "new")));
    d.append(p); s.append(d);
  });
  if (D.blocks.length > shown) s.append(el("p", `and ${D.blocks.length - shown} more groups`, "dim"));
  if (!D.blocks.length) s.append(el("p", "no block differs", "dim"));
}
everything();
