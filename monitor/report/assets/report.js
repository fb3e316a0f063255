"use strict";
(() => {
const $ = (selector, root = document) => root.querySelector(selector);
const $$ = (selector, root = document) => [...root.querySelectorAll(selector)];
const [NAME, KIND, CI, MS, EVENTS, FLAGS, WHY, ACTION, HAS] = [0, 1, 2, 3, 4, 5, 6, 7, 8];
const PAGE = 100, FIRST_OPEN = 3, MANY = 10, DAY = 86400;
const INK = "#1b2430", DATA = "#0072b2", MODEL = "#d55e00", SET = "#5a6472", OUT = "#7b4f9d", GRID = "#e6eaee";
const meanings = JSON.parse($("#meanings").textContent);
const rows = JSON.parse($("#index").textContent);
const blocks = $$("script.section");
const sectionOf = new Map();  // row number -> its block
rows.forEach((row, n) => { row.n = n; if (row[HAS]) sectionOf.set(n, blocks[sectionOf.size]); });
const byName = new Map(rows.map((row) => [row[NAME], row.n]));
const kinds = new Map($$(".tile").map((tile) => [tile.dataset.kind, {
  words: $("span", tile).textContent, colour: $("path", tile).getAttribute("fill"), shape: $("path", tile).getAttribute("d") }]));
const state = { sort: "danger", up: true, kind: "", words: [], shown: PAGE };

// -- the table ----------------------------------------------------------------------------------------

function element(name, text, className) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (className) made.className = className;
  return made;
}
function mark(kind) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "-7 -7 14 14"); svg.setAttribute("class", "mark"); svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  path.setAttribute("d", kinds.get(kind).shape); path.setAttribute("fill", kinds.get(kind).colour);
  svg.append(path); return svg;
}
function figure(text) { return text === "" ? NaN : text === "∞" ? Infinity : Number(text.replace("−", "-")); }
const keys = {
  danger: (row) => row.n, name: (row) => row[NAME], kind: (row) => kinds.get(row[KIND]).words,
  ci: (row) => figure(row[CI]), ms: (row) => figure(row[MS]), events: (row) => row[EVENTS] };
const order = new Intl.Collator("en", { numeric: true }).compare;
function compare(a, b) {
  const x = keys[state.sort](a), y = keys[state.sort](b);
  if (typeof x === "string") return (state.up ? 1 : -1) * order(x, y) || a.n - b.n;
  if (Number.isNaN(x) || Number.isNaN(y)) return Number.isNaN(x) - Number.isNaN(y) || a.n - b.n;  // the unknown come last
  return (state.up ? 1 : -1) * (x < y ? -1 : x > y ? 1 : 0) || a.n - b.n;
}
function fits(row) {
  if (state.kind && row[KIND] !== state.kind) return false;
  if (!state.words.length) return true;
  const text = row.text ??= [row[NAME], kinds.get(row[KIND]).words, row[FLAGS], row[WHY], row[ACTION]].join(" ").toLowerCase();
  return state.words.every((word) => text.includes(word));
}
function draw() {
  const found = rows.filter(fits).sort(compare), body = $("#table tbody");
  body.replaceChildren(...found.slice(0, state.shown).map(line));
  $("#found").textContent = `${found.length} of ${rows.length} loops`;
  $("#more").hidden = found.length <= state.shown;
  $("#more").textContent = `Show ${Math.min(PAGE * 5, found.length - state.shown)} more of ${found.length}`;
  for (const button of $$("#table [data-sort]"))
    button.parentElement.setAttribute("aria-sort", button.dataset.sort !== state.sort ? "none" : state.up ? "ascending" : "descending");
  for (const tile of $$(".tile")) tile.setAttribute("aria-pressed", String(tile.dataset.kind === state.kind));
  $("#kind").value = state.kind;
}
function line(row) {
  const tr = element("tr"), name = element("td"), kind = element("td");
  if (row[HAS]) {
    const link = element("button", row[NAME], "link"); link.type = "button"; link.dataset.loop = row[NAME]; name.append(link);
  } else { name.textContent = row[NAME]; name.title = "good, or nothing to be shown: see the tables"; }
  kind.append(mark(row[KIND]), kinds.get(row[KIND]).words);
  tr.append(element("td", row.n + 1, "n"), name, kind, element("td", row[CI]), element("td", row[MS]),
    element("td", row[EVENTS]), element("td", row[WHY]), element("td", row[FLAGS].replaceAll("_", " ")));
  return tr;
}

// -- a loop's section ---------------------------------------------------------------------------------

function show(n, { scroll = true } = {}) {
  const block = sectionOf.get(n);
  if (!block) return;
  let section = $(`.loop[data-n="${n}"]`);
  if (!section) {
    const what = JSON.parse(block.textContent);
    section = element("section", undefined, "loop");
    section.dataset.n = n; section.tabIndex = -1;
    section.style.setProperty("--kind", kinds.get(rows[n][KIND]).colour);
    section.innerHTML = what.html;  // the page's own template, escaped where it was filled
    section.setAttribute("aria-label", rows[n][NAME]);
    const after = $$(".loop").find((other) => Number(other.dataset.n) > n);
    $("#open").insertBefore(section, after ?? null);
    condition($(".condition tbody", section), what.health);
    prepare(section, what);
  }
  if (scroll) { section.scrollIntoView({ block: "start" }); section.focus({ preventScroll: true }); }
}
function condition(body, figures) {
  for (const [name, value] of figures) {
    const tr = element("tr"), [unit, says, act] = meanings[name], cell = element("td", `${value} `, "value");
    cell.append(element("small", unit));
    tr.append(element("td", name.replaceAll("_", " ")), cell, element("td", says), element("td", act));
    body.append(tr);
  }
}
function unpack(column, count) {
  if (!column.length) return new Array(count).fill(null);
  if (Array.isArray(column[0])) {  // a value from each row on
    const values = new Array(count);
    column.forEach(([row, value], k) => values.fill(value, row, column[k + 1]?.[0] ?? count));
    return values;
  }
  if (column.length === 4) return Array.from({ length: column[2] }, (_, k) => column[0] + column[1] * k);  // even steps
  if (column.length === 1) return new Array(count).fill(column[0]);
  const [low, step, text] = column, bytes = atob(text), values = new Array(bytes.length / 2);
  for (let k = 0; k < values.length; k++) {
    const code = bytes.charCodeAt(2 * k) | (bytes.charCodeAt(2 * k + 1) << 8);
    values[k] = code === 65535 ? null : low + step * code;
  }
  return values;
}
const seen = new IntersectionObserver((entries) => {
  for (const entry of entries) if (entry.isIntersecting) paint(entry.target);
}, { rootMargin: "600px" });
function paint(holder) {
  if (!holder.paint) return;
  seen.unobserve(holder); const work = holder.paint; holder.paint = null; work();
}
function later(holder, height, work) {
  holder.classList.add("holder"); holder.style.minHeight = `${height}px`; holder.paint = work; seen.observe(holder);
}
function key(parts) {
  const p = element("p", undefined, "key");
  for (const [name, colour, style] of parts) {
    const i = element("i", undefined, style ?? "");
    if (style === "area") i.style.background = colour; else i.style.borderTopColor = colour;
    p.append(i, name);
  }
  return p;
}
function prepare(section, what) {
  const answers = $(".answers", section), events = $(".events", section);  // trend and events
  if (what.answers.length) {
    answers.append(element("h4", "Predicted response to a step: today against after the retune, with the band of the models that the data allow"));
    const plots = element("div", undefined, "plots"); answers.append(plots);
    for (const answer of what.answers) plots.append(answerPlot(answer));
  }
  if (what.trend.length) {
    events.append(element("h4", "Trend: the newest samples"));
    for (const trend of what.trend) events.append(eventPlot(trend));
  }
  if (what.events.length) {
    events.append(element("h4", "Measured: the newest events, with the model over the data and what it leaves beneath"));
    const plots = element("div", undefined, "plots"); events.append(plots);
    for (const event of what.events) plots.append(eventPlot(event));
  }
}
function scaleOf(seconds) {
  return seconds > 2 * DAY ? [DAY, "d"] : seconds > 10800 ? [3600, "h"] : seconds > 300 ? [60, "min"] : [1, "s"];
}
const tick = (v) => Math.abs(v) >= 1e5 || (v !== 0 && Math.abs(v) < 1e-3) ? v.toExponential(1) : String(+v.toPrecision(6));
function axes(xLabel, yLabel) {
  const common = { stroke: INK, grid: { stroke: GRID, width: 1 }, ticks: { stroke: GRID }, font: "11px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" };
  return [{ ...common, label: xLabel, labelSize: xLabel ? 18 : 0, size: xLabel ? 26 : 4, values: (_, ticks) => ticks.map(xLabel ? tick : () => "") },
    { ...common, label: yLabel, labelSize: 16, size: 52, values: (_, ticks) => ticks.map(tick) }];
}
function chart(holder, height, data, series, { xLabel = "", yLabel = "", bands, hooks, sync } = {}) {
  return new uPlot({
    width: Math.max(holder.clientWidth, 320), height, scales: { x: { time: false } }, legend: { show: false },
    series: [{}, ...series.map((one) => ({ points: { show: false }, spanGaps: false, ...one }))],
    axes: axes(xLabel, yLabel), bands, hooks,
    cursor: sync ? { sync: { key: sync, setSeries: false }, points: { show: false } } : { points: { show: false } },
    padding: [6, 8, 0, 0],
  }, data, holder);
}
const stepped = uPlot.paths.stepped({ align: 1 });
function answerPlot(answer) {
  const plot = element("div", undefined, "plot"), holder = element("div");
  const time = unpack(answer.t, 0), count = time.length, [size, unit] = scaleOf(time[count - 1] - time[0]);
  const get = (name) => unpack(answer[name], count);
  const known = (values) => values.some((v) => v !== null);
  const now = get("today"), new_ = get("new"), setpoint = answer.kind === "setpoint";
  plot.append(element("h5", setpoint ? "after a set-point step of 1 [PV]" : "after a load step of 1 [OP] at the process input"));
  const open = (name, curve) => known(curve) && get(`${name}_lo`).some((v) => v === null);
  plot.append(key([["today", SET, "dash"], ...(known(new_) ? [["after", DATA]] : []), ["band of the models", "#0072b233", "area"]]));
  if (!known(now) && answer.today.length === 0) plot.append(element("p", "today: not known, or unstable on the model"));
  for (const [name, curve, words] of [["today", now, "today's settings"], ["new", new_, "the new settings"]])
    if (open(name, curve)) plot.append(element("p", `with ${words} some models that the data allow are unstable: no band`));
  plot.append(holder);
  later(holder, 230, () => chart(holder, 230, [time.map((t) => t / size), get("today_lo"), get("today_hi"), get("new_lo"), get("new_hi"), now, new_], [
    { stroke: "transparent" }, { stroke: "transparent" }, { stroke: "transparent" }, { stroke: "transparent" },
    { stroke: SET, width: 1.5, dash: [6, 4] }, { stroke: DATA, width: 2.2 }],
    { xLabel: `from the step on [${unit}]`, yLabel: "PV", bands: [{ series: [2, 1], fill: "#5a647226" }, { series: [4, 3], fill: "#0072b22e" }],
      hooks: { drawAxes: [(u) => setpoint && level(u, 1)] } }));
  return plot;
}
function level(u, value) {
  const y = u.valToPos(value, "y", true), { left, width } = u.bbox;
  u.ctx.save(); u.ctx.strokeStyle = "#9aa3ae"; u.ctx.setLineDash([2, 3]);
  u.ctx.beginPath(); u.ctx.moveTo(left, y); u.ctx.lineTo(left + width, y); u.ctx.stroke(); u.ctx.restore();
}
function span(u, from, to) {
  const { left, top, width, height } = u.bbox, a = u.valToPos(from, "x", true), b = u.valToPos(to, "x", true);
  u.ctx.save(); u.ctx.fillStyle = "#fff6d6"; u.ctx.fillRect(Math.max(a, left), top, Math.min(b, left + width) - Math.max(a, left), height);
  u.ctx.strokeStyle = "#b07d00"; u.ctx.lineWidth = devicePixelRatio; u.ctx.setLineDash([4, 3]);
  u.ctx.beginPath(); u.ctx.moveTo(a, top); u.ctx.lineTo(a, top + height); u.ctx.stroke(); u.ctx.restore();
}
let number = 0;
function eventPlot(event) {
  const plot = element("div", undefined, "plot"), holder = element("div");
  plot.append(element("h5", event.title), element("p", event.note));
  const time = unpack(event.t, 0), count = time.length, [size, unit] = scaleOf(time[count - 1] - time[0]);
  const model = unpack(event.model, count), has = model.some((v) => v !== null);
  plot.append(key([["PV", DATA], ["SP", SET, "dash"], ...(has ? [["model", MODEL]] : []), ["OP", OUT],
    ...(event.end === null ? [] : [["window, from the onset on", "#fff0b8", "area"]])]), holder);
  later(holder, has ? 400 : 320, () => {
    const x = time.map((t) => t / size), sync = `e${number++}`;
    const pv = unpack(event.pv, count), residual = pv.map((v, k) => v === null || model[k] === null ? null : v - model[k]);
    const hooks = event.end === null ? {} : { drawClear: [(u) => span(u, 0, event.end / size)] };
    chart(holder, 200, [x, unpack(event.sp, count), pv, model],
      [{ stroke: SET, width: 1.5, dash: [6, 4], paths: stepped }, { stroke: DATA, width: 1.4 }, { stroke: MODEL, width: 1.8 }], { yLabel: "PV, SP", hooks, sync });
    if (has) chart(holder, 90, [x, residual], [{ stroke: DATA, width: 1 }], { yLabel: "PV−model", hooks: { ...hooks, drawAxes: [(u) => level(u, 0)] }, sync });
    chart(holder, 120, [x, unpack(event.op, count)], [{ stroke: OUT, width: 1.5, paths: stepped }], { xLabel: `from the ${event.end === null ? "beginning" : "onset"} on [${unit}]`, yLabel: "OP", hooks, sync });
  });
  return plot;
}

// -- what a reader does -------------------------------------------------------------------------------

function change(what) { Object.assign(state, { shown: PAGE }, what); draw(); }
$("#search").addEventListener("input", (e) => change({ words: e.target.value.toLowerCase().split(/\s+/).filter(Boolean) }));
$("#kind").addEventListener("change", (e) => change({ kind: e.target.value }));
$("#more").addEventListener("click", () => { state.shown += PAGE * 5; draw(); });
$("#first").addEventListener("click", () => [...sectionOf.keys()].slice(0, MANY).forEach((n) => show(n, { scroll: false })));
$("#shut").addEventListener("click", () => $("#open").replaceChildren());
document.addEventListener("click", (e) => {
  const sort = e.target.closest("[data-sort]"), loop = e.target.closest("[data-loop]"), tile = e.target.closest(".tile");
  if (sort) change(state.sort === sort.dataset.sort ? { up: !state.up } : { sort: sort.dataset.sort, up: sort.dataset.sort !== "ms" && sort.dataset.sort !== "events" });
  else if (tile) { change({ kind: state.kind === tile.dataset.kind ? "" : tile.dataset.kind }); $("#loops").scrollIntoView(); }
  else if (loop) { const n = byName.get(loop.dataset.loop); if (sectionOf.has(n)) show(n); else find(loop.dataset.loop); }
  else if (e.target.closest(".close")) e.target.closest(".loop").remove();
});
function find(name) { $("#search").value = name; change({ words: name.toLowerCase().split(/\s+/).filter(Boolean), kind: "" }); $("#loops").scrollIntoView(); }
document.addEventListener("keydown", (e) => {
  if (e.ctrlKey || e.metaKey || e.altKey) return;
  const typing = /^(INPUT|SELECT|TEXTAREA)$/.test(e.target.tagName), here = e.target.closest(".loop");
  if (e.key === "Escape") {
    if (here) here.remove(); else if (typing) { $("#search").value = ""; change({ words: [] }); e.target.blur(); }
  } else if (!typing && e.key === "/") { e.preventDefault(); $("#search").focus(); $("#loops").scrollIntoView(); }
  else if (!typing && (e.key === "j" || e.key === "k")) {
    const open = $$(".loop"), k = open.indexOf(here);
    const next = open[e.key === "j" ? k + 1 : Math.max(k - 1, 0)];
    if (next) { next.scrollIntoView(); next.focus({ preventScroll: true }); }
  }
});
window.addEventListener("beforeprint", () => $$(".holder").forEach(paint));
draw();
[...sectionOf.keys()].slice(0, FIRST_OPEN).forEach((n) => show(n, { scroll: false }));
document.documentElement.dataset.ready = "true";
})();
