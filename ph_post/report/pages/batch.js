// A batch: how many programs, what they gain together, and a row each.
const ROWS = D.rows, STATES = ["compensated", "unchanged", "refused", "failed"].filter(s => ROWS.some(r => r.status === s));
const middle = values => { const v = values.filter(x => x !== null).sort((a, b) => a - b); return v.length ? v[v.length >> 1] : null; };
const span = s => s < 100 ? `${num(s, 1)} s` : s < 6000 ? `${num(s / 60, 1)} min` : `${num(s / 3600, 1)} h`;
const total = values => values.reduce((sum, v) => sum + (v || 0), 0);
{
  const left = D.missing ? ` · ${D.missing} still to come` : "";
  main.append(el("h1", `${ROWS.length} results · ${STATES.map(s => `${ROWS.filter(r => r.status === s).length} ${s}`).join(", ")}${left}`));
  const tiles = el("div", undefined, "tiles");
  const tile = (title, values, below) => {
    const t = el("div", undefined, "tile"), b = el("b");
    values.forEach((v, n) => b.append(...(n ? [" → "] : []), el(values.length > 1 && n === 0 ? "i" : "em", v)));
    t.append(title, b, el("span", below, "dim")); tiles.append(t);
  };
  const both = ROWS.filter(r => r.before !== null && r.after !== null), timed = ROWS.filter(r => r.time[0] !== null);
  const done = total(ROWS.map(r => r.reversals[0])), all = total(ROWS.map(r => r.reversals[1]));
  tile("Backlash error, µm", [micrometres(middle(both.map(r => r.before))), micrometres(middle(both.map(r => r.after)))], "median of the largest errors");
  tile("Reversals compensated", [all ? `${few(100 * done / all)} %` : "–"], `${done} of ${all}`);
  tile("Time on the machines", [0, 1].map(n => span(total(timed.map(r => r.time[n])))), `of ${timed.length} programs`);
  tile("Work", [span(total(ROWS.map(r => r.seconds)))], "of all workers together");
  main.append(tiles);
}
{
  const s = section("Programs"), bar = el("div", undefined, "bar hand"), find = el("input"), box = el("label", "find ");
  let wanted = "all", order = ROWS.map((_, k) => k), most = 300, shown = most;
  find.type = "search";
  find.oninput = () => { shown = most; fill(); };
  box.append(find);
  bar.append(choice(["all", ...STATES], "all", name => { wanted = name; shown = most; fill(); }), box);
  const pair = (r, name) => r[name][1] === null ? "–" : `${r[name][0]} of ${r[name][1]}`;
  const columns = [
    ["file", r => r.file, r => r.file], ["machine", r => r.machine, r => r.machine], ["status", r => r.status, r => r.status],
    ["before µm", r => micrometres(r.before), r => r.before], ["after µm", r => micrometres(r.after), r => r.after],
    ["worst case µm", r => micrometres(r.worst), r => r.worst],
    ["time s", r => num(r.time[0], 1), r => r.time[0]], ["after s", r => num(r.time[1], 1), r => r.time[1]],
    ["reversals", r => pair(r, "reversals"), r => r.reversals[1]],
    ["compensated", r => r.share === null ? "–" : `${few(100 * r.share)} %`, r => r.share],
    ["work s", r => num(r.seconds, 1), r => r.seconds],
    ["notes", r => r.words.join("; "), r => r.words.join()],
  ];
  const wordy = columns.length - 1;
  const t = table(columns.map(() => ""), []), head = t.querySelectorAll("th"), body = t.querySelector("tbody");
  columns.forEach(([name, , of], n) => {
    if (n === wordy) head[n].className = "words";
    head[n].append(button(name, () => {
      const down = head[n].getAttribute("aria-sort") === "ascending";
      head.forEach(one => one.removeAttribute("aria-sort"));
      head[n].setAttribute("aria-sort", down ? "descending" : "ascending");
      const rank = v => v === null || v === undefined ? -Infinity : v;
      order.sort((a, b) => { const x = rank(of(ROWS[a])), y = rank(of(ROWS[b])); return (x < y ? -1 : x > y ? 1 : a - b) * (down ? -1 : 1); });
      fill();
    }));
  });
  head[0].setAttribute("aria-sort", "ascending");
  const told = el("p", "", "dim"), more = button("show all", () => { shown = Infinity; fill(); });
  more.className = "more hand";
  function fill() {
    const text = find.value.toLowerCase();
    const fits = r => (wanted === "all" || r.status === wanted) && (!text || `${r.file} ${r.machine} ${r.words.join(" ")}`.toLowerCase().includes(text));
    const found = order.filter(k => fits(ROWS[k]));
    body.textContent = "";
    found.slice(0, shown).forEach(k => {
      const r = el("tr");
      columns.forEach(([, cell], n) => r.append(el("td", cell(ROWS[k]), n === wordy ? "words" : "")));
      body.append(r);
    });
    told.textContent = `${Math.min(shown, found.length)} of ${ROWS.length} shown`;
    more.hidden = found.length <= shown;
  }
  fill();
  const wide = scroll(t);
  wide.style.maxHeight = "none";
  s.append(bar, wide, told, more);
}
