"use strict";
// The page: its sections from a record, the time common to all of them, and updates of a run in progress.

function el(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== undefined) made.setAttribute(name, value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

const number = (value) => (Math.abs(value) >= 1e5 || (value && Math.abs(value) < 1e-3) ? value.toExponential(2) : Number(value.toPrecision(4)).toString());

const page = { runs: [], sweeps: [], players: [], spaces: [], sections: {}, charts: [], maps: [], spectra: [], readings: [], t: 0, playing: false, speed: 1, field: "pressure", drawn: 0 };
window.jaxsph = page;

// --- time

function span() {
  const ends = page.players.flatMap((one) => [one.player.t[0], one.player.t[one.player.t.length - 1]]);
  return ends.length ? [Math.min(...ends), Math.max(...ends)] : [0, 0];
}

function seek(t, follow = false) {
  const [first, last] = span();
  page.t = Math.min(Math.max(t, first), last);
  page.follow = follow;
  show();
}

function show() {
  const style = { back: backColour(), wall: css("--wall"), still: css("--still"), halo: css("--card"), card: css("--card"), text: css("--text"), mark: css("--mark") };
  for (const water of page.players) page.drawn = water.show(page.t, page.field, style);
  for (const space of page.spaces) {
    space.show(page.t, sectionOf(space.run).y, style);
    // the description changes at most twice a second, because nobody reads faster
    if (page.playing && performance.now() - (space.since || 0) < 500) continue;
    space.since = performance.now();
    space.told.textContent = space.words(page.t);
    space.canvas.setAttribute("aria-label", `${space.label} ${space.told.textContent}`);
  }
  if (page.firstPicture === undefined && page.players.length) page.firstPicture = performance.now();
  page.pictures = (page.pictures || 0) + 1;
  if (page.slider) {
    page.slider.value = page.t;
    page.slider.setAttribute("aria-valuetext", `${page.t.toFixed(2)} seconds`);
    page.clock.textContent = `t = ${page.t.toFixed(2)} s`;
  }
  for (const chart of page.charts) chart.mark(page.t);
  for (const { line, place, unit } of page.readings) {
    const [k, share] = placeAmong(line.t, page.t), next = Math.min(k + 1, line.y.length - 1);
    place.textContent = `${number(line.y[k] * (1 - share) + line.y[next] * share)} ${unit}`;
  }
}

function backColour() {
  const [r, g, b] = css("--card").match(/[0-9a-f]{2}/gi).map((two) => parseInt(two, 16));
  return (0xff000000 | (b << 16) | (g << 8) | r) >>> 0;
}

function play(on) {
  page.playing = on;
  page.button.textContent = on ? "Pause" : "Play";
  if (!on) { show(); return; }
  const [first, last] = span();
  if (page.t >= last - 1e-9) page.t = first;
  let before = performance.now();
  const step = (now) => {
    if (!page.playing) return;
    page.t += page.speed * (now - before) / 1000;
    before = now;
    if (page.t >= last) { page.t = last; play(false); }
    show();
    if (page.playing) requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}

// --- sections

function section(title, ...children) {
  const id = title.toLowerCase().replace(/[^a-z]+/g, "-");
  return el("section", { "aria-labelledby": id }, el("h2", { id }, title), ...children);
}

function warnings() {
  const all = [...page.runs, ...page.sweeps].flatMap((one) => one.warnings.map((text) => (page.runs.length + page.sweeps.length > 1 ? `${one.label || one.name}: ${text}` : text)));
  if (!all.length) return null;
  return el("ul", { class: "warnings", "aria-label": "Warnings" }, ...all.map((text) => el("li", {}, text)));
}

// The main result of every run or sweep, beside its value by linear theory.
function answer() {
  const all = [...page.runs, ...page.sweeps], found = all.filter((one) => one.answer);
  if (!found.length) return null;
  return el("ul", { class: "answer", "aria-label": "Main result" }, ...found.map((one) => el("li", {}, all.length > 1 ? `${one.label || one.name}: ` : "", `${one.answer.label} `,
    el("strong", {}, `${one.answer.value} ${one.answer.unit}`.trim()), one.answer.expected ? `; linear theory ${one.answer.expected}` : "",
    one.answer.note ? el("small", {}, ` (${one.answer.note})`) : "")));
}

function results() {
  const names = [], rows = {};
  for (const run of page.runs) for (const row of run.results) if (!(row.name in rows)) { names.push(row.name); rows[row.name] = row; }
  if (!names.length) return null;
  const several = page.runs.length > 1;
  const head = el("tr", {}, el("th", { scope: "col" }, "result"), ...page.runs.map((run) => el("th", { scope: "col", class: "value" }, several ? run.label : "value")), el("th", { scope: "col" }, "unit"), el("th", { scope: "col", class: "meaning" }, "meaning"));
  const row = (name) => el("tr", { class: rows[name].part ? "part" : "" }, el("th", { scope: "row" }, rows[name].label),
    ...page.runs.map((run) => el("td", { class: "value" }, (run.results.find((one) => one.name === name) || { value: "–" }).value)),
    el("td", {}, rows[name].unit), el("td", { class: "meaning" }, rows[name].meaning));
  const table = (group) => el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": `Table of results: ${group}` },
    el("table", {}, el("thead", {}, head.cloneNode(true)), el("tbody", {}, ...names.filter((name) => rows[name].group === group).map(row))));
  const groups = ["device", "waves"].filter((group) => names.some((name) => rows[name].group === group));
  const shown = groups.map((group) => el("div", {}, el("h3", {}, group === "device" ? "Device" : "Waves"), table(group)));
  return section("Results", ...shown, el("details", {}, el("summary", {}, "How far to trust the results: energy balance, noise, cost"), table("numerics")));
}

function about() {
  if (!page.runs.length) return null;
  const names = [];
  for (const run of page.runs) for (const [name] of run.about) if (!names.includes(name)) names.push(name);
  const head = page.runs.length > 1 ? [el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "run"), ...page.runs.map((run) => el("th", { scope: "col" }, run.label))))] : [];
  const rows = names.map((name) => el("tr", {}, el("th", { scope: "row" }, name), ...page.runs.map((run) => el("td", {}, (run.about.find(([one]) => one === name) || ["", "–"])[1]))));
  const texts = [...new Set(page.runs.map((run) => run.description).filter(Boolean))].map((text) => el("p", {}, text));
  return section("What was run", ...texts, el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Table of what was run" }, el("table", {}, ...head, el("tbody", {}, ...rows))));
}

function particles() {
  const known = page.spaces;
  page.players = [];
  page.spaces = [];
  page.readings = [];
  const shown = page.runs.filter((run) => run.player);
  if (!shown.length) return null;
  const stages = shown.map((run) => {
    const canvas = el("canvas", { class: "water", role: "img", "aria-label": `Particles of ${run.label} in the tank, coloured by ${page.field}; values in the readings below` });
    const water = new Water(canvas, { ...run, player: { ...run.player, ...sectionOf(run) } });
    page.players.push(water);
    drag(canvas, water);
    const section = el("div", {}, canvas, run.player.slice ? sectionChoice(run, water) : null);
    const both = run.player.slice ? el("div", { class: "beside" }, section, spaceStage(run, known.find((space) => space.run.label === run.label))) : section;
    return el("div", {}, shown.length > 1 ? el("h3", {}, run.label) : null, both, readings(run));
  });
  const views = page.spaces.length ? el("p", { class: "hint" }, "In the view in three dimensions, drag or use the arrow keys to turn, hold Shift and drag to move, and use + and − or Ctrl and the mouse wheel to zoom. Press 0 to show the whole tank. The rectangle marks the section that is shown beside the view. The dashed line is the still water level.") : null;
  const thinnest = Math.max(...shown.map((run) => run.player.thinning));
  const thinned = thinnest > 1 ? el("p", { class: "hint" }, `One particle in ${thinnest} is shown, enlarged.`) : null;
  return section("Particles", el("div", { class: "player", role: "group", "aria-label": "Playback of the particles" }, ...stages, controls(), legend(), views, thinned,
    el("p", { class: "hint" }, "Keys: space plays or pauses, ← and → step, + and − zoom, 0 shows the whole tank. Drag to move the picture; use Ctrl and the mouse wheel to zoom. Click in a chart to show the particles at that time.")));
}

// The section of a run that is shown, an x-z plane at the position y across the tank; y is null in two dimensions.
function sectionOf(run) {
  const all = run.player.sections, chosen = page.sections[run.label];
  return all[chosen === undefined ? Math.floor(all.length / 2) : Math.min(chosen, all.length - 1)];
}

function sectionChoice(run, water) {
  const all = run.player.sections, now = sectionOf(run), words = ({ y }) => `y = ${number(Number(y.toPrecision(3)))} m`;
  if (all.length === 1) return el("p", { class: "hint" }, `Section at ${words(now)}, in the middle of the tank's width.`);
  const choice = el("select", { onchange: () => {
    page.sections[run.label] = +choice.value;
    water.take({ ...run, player: { ...run.player, ...sectionOf(run) } });
    show();
  } }, ...all.map((one, k) => el("option", { value: k, selected: one === now }, words(one))));
  return el("label", { class: "section" }, "Section at ", choice);
}

function readings(run) {
  const rows = run.panels.filter((panel) => panel.running).map((panel) => {
    const place = el("dd", {});
    page.readings.push({ line: panel.lines[0], place, unit: panel.unit });
    return el("div", {}, el("dt", {}, panel.title.split(",")[0]), place);
  });
  return rows.length ? el("dl", { class: "readings" }, ...rows) : null;
}

function controls() {
  const [first, last] = span();
  page.t = Math.min(Math.max(page.t || last, first), last);
  page.button = el("button", { type: "button", id: "play", onclick: () => play(!page.playing) }, "Play");
  page.slider = el("input", { type: "range", id: "time", min: first, max: last, step: "any", value: page.t, "aria-label": "Time", oninput: () => seek(+page.slider.value) });
  page.clock = el("output", { for: "time" });
  const speed = el("select", { id: "speed", "aria-label": "Speed of playback", onchange: () => { page.speed = +speed.value; } },
    ...[[0.1, "a tenth"], [0.25, "a quarter"], [0.5, "half"], [1, "real time"], [2, "twice"], [5, "five times"]].map(([value, text]) => el("option", { value, selected: value === page.speed }, text)));
  const fields = page.players[0].frames.fields;
  const colour = el("select", { id: "colour", "aria-label": "Colour of the particles", onchange: () => { page.field = colour.value; drawLegend(); show(); } },
    ...Object.keys(fields).map((name) => el("option", { value: name, selected: name === page.field }, name)));
  const press = (text, label, does) => el("button", { type: "button", "aria-label": label, onclick: () => { for (const water of page.players) does(water); show(); } }, text);
  const device = page.players.some((water) => water.player.tank.zoom) ? press("Device", "Show the device", (water) => water.fit("device")) : null;
  return el("div", { class: "controls" }, page.button, page.slider, page.clock, speed, colour,
    press("−", "Zoom out", (water) => water.zoomBy(1 / 1.4)), press("+", "Zoom in", (water) => water.zoomBy(1.4)),
    device, press("Tank", "Show the whole tank", (water) => water.fit("tank")));
}

function legend() {
  page.bar = el("canvas", { width: 256, height: 1, role: "img", "aria-label": "Scale of the colours" });
  page.scale = [el("span", {}), el("span", {}), el("span", {})];
  return el("div", { class: "legend" }, page.scale[0], page.scale[1], page.bar, page.scale[2]);
}

// The colour scale of the first player; the limits of other players can differ.
function drawLegend() {
  if (!page.bar || !page.players.length) return;
  const field = page.players[0].frames.fields[page.field];
  paint(page.bar, field.colours);
  const several = page.players.length > 1 ? `, of ${page.runs.find((run) => run.player).label}` : "";
  page.scale[0].textContent = field.label + several;
  page.scale[1].textContent = number(field.low);
  page.scale[2].textContent = number(field.high);
  page.players.forEach((water, k) => water.canvas.setAttribute("aria-label", `Particles of ${page.runs.filter((run) => run.player)[k].label} in the tank, coloured by ${field.label}; values in the readings below`));
}

function drag(canvas, water) {
  const ratio = () => canvas.width / canvas.clientWidth;
  gestures(canvas, (px, py) => water.panBy(px * ratio(), py * ratio()),
    (by, event) => water.zoomBy(by, event.offsetX * ratio(), event.offsetY * ratio()));
}

// Calls `move` while a pointer is dragged over a canvas, and `zoom` for the mouse wheel with Ctrl.
function gestures(canvas, move, zoom) {
  let from = null;
  canvas.addEventListener("pointerdown", (event) => { from = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", (event) => {
    if (!from) return;
    move(event.clientX - from[0], event.clientY - from[1], event);
    from = [event.clientX, event.clientY];
    show();
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { from = null; });
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    zoom(Math.exp(-event.deltaY * 0.004), event);
    show();
  }, { passive: false });
}

function overTime() {
  const groups = page.runs.filter((run) => run.panels.length).map((run) => ({ label: run.label, panels: run.panels }));
  if (!groups.length) return null;
  const place = el("div", {});
  page.charts.push(new Charts(place, groups, (t) => seek(t)));
  return section("Over time", el("p", { class: "hint" }, "Drag over a chart to zoom all charts; double-click to show the whole run again. Click a name beside a chart to hide or show its line. Dashed: linear theory."), place, numbers(groups));
}

// What the charts show, as a table for readers who cannot see them.
function numbers(groups) {
  const rows = groups.flatMap((group) => group.panels.flatMap((panel) => panel.lines.map((line) => {
    let low = Infinity, high = -Infinity, sum = 0;
    for (const value of line.y) { low = Math.min(low, value); high = Math.max(high, value); sum += value; }
    return el("tr", {}, el("th", { scope: "row" }, `${groups.length > 1 ? `${group.label}: ` : ""}${panel.title}${panel.lines.length > 1 ? `, ${line.name}` : ""}`),
      ...[low, sum / line.y.length, high].map((value) => el("td", { class: "value" }, number(value))), el("td", {}, panel.unit));
  })));
  const head = el("tr", {}, ...["series", "least", "mean of samples", "largest", "unit"].map((text) => el("th", { scope: "col" }, text)));
  return el("details", {}, el("summary", {}, "The charts as a table"), el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "The charts as a table" }, el("table", {}, el("thead", {}, head), el("tbody", {}, ...rows))));
}

function spectra() {
  const found = page.runs.flatMap((run) => run.spectra.map((one) => ({ ...one, title: page.runs.length > 1 ? `${run.label}: ${one.title}` : one.title })));
  if (!found.length) return null;
  return section("Spectra", ...found.flatMap((one) => {
    const place = el("div", {});
    page.spectra.push([place, one]);
    return [el("h3", {}, one.title), place];
  }));
}

function cases() {
  const all = [...page.runs, ...page.sweeps];
  return section("Case", el("p", { class: "hint" }, "The whole case, as a file for jaxsph run."), ...all.map((one) => el("details", {}, el("summary", {}, `${one.label || one.name}.toml`), el("pre", { tabindex: "0" }, one.case))));
}

function sweepSections() {
  return page.sweeps.flatMap((sweep, k) => {
    const place = el("div", { class: "map" }), opened = el("div", { id: `opened-${k}`, "aria-live": "polite" });
    const map = new Map2(place, sweep, (members) => open(sweep, members, opened));
    page.maps.push(map);
    const choice = el("select", { "aria-label": "Result to show", onchange: () => { map.of = choice.value; map.draw(); } }, ...sweep.choices.map((one) => el("option", { value: one.name, selected: one.name === sweep.first }, one.text.trim())));
    const what = { matrix: "Power matrix", search: "Search", sweep: "Sweep" }[sweep.kind];
    const rows = sweep.members.map((one) => el("tr", {}, el("th", { scope: "row" }, one.place), el("td", { class: "value" }, sweep.first in one.results ? number(one.results[sweep.first]) : one.failure ? "failed" : "–"),
      el("td", {}, el("button", { type: "button", class: "open", onclick: () => open(sweep, [one.index], opened), "aria-label": `Open ${one.place}` }, "Open"))));
    const head = el("tr", {}, el("th", { scope: "col" }, "member"), el("th", { scope: "col" }, (sweep.choices.find((one) => one.name === sweep.first) || { text: "result" }).text), el("th", { scope: "col" }, "series"));
    return [section(`${what} of ${sweep.name}`, el("p", { class: "hint" }, "A click on a result opens its member. Dashed or in italics: linear theory."), choice, place,
      el("details", {}, el("summary", {}, sweep.counted), el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Table of members" }, el("table", {}, el("thead", {}, head), el("tbody", {}, ...rows)))), opened)];
  });
}

async function open(sweep, members, place) {
  const chosen = members.map((index) => sweep.members.find((one) => one.index === index));
  const tables = chosen.map((one) => el("div", {}, el("h3", {}, one.place), one.failure ? el("p", { class: "warnings" }, one.failure) : null,
    el("table", {}, el("tbody", {}, ...one.rows.map((row) => el("tr", {}, el("th", { scope: "row" }, row.label), el("td", { class: "value" }, row.value), el("td", {}, row.unit), el("td", {}, row.limit && `limit for spacing zero: ${row.limit}`)))))));
  const chart = el("div", {}), groups = chosen.filter((one) => one.panels.length).map((one) => ({ label: one.place, panels: one.panels }));
  place.replaceChildren(el("h2", {}, chosen.length > 1 ? "Members" : "Member"), chart, ...tables);
  page.charts = page.charts.filter((one) => !one.ofMember);
  if (groups.length) {
    const made = new Charts(chart, groups, () => {});
    made.ofMember = true;
    page.charts.push(made);
    await made.draw();
  }
  place.scrollIntoView({ behavior: matchMedia("(prefers-reduced-motion: reduce)").matches ? "auto" : "smooth" });
}

// --- start and updates

async function drawCharts() {
  for (const chart of page.charts) await chart.draw();
  for (const map of page.maps) await map.draw();
  for (const [place, found] of page.spectra) await drawSpectra(place, found);
}

async function take(bytes) {
  const content = await readRecord(bytes);
  const kept = { views: page.players.map((water) => [water.view, water.moved, water.look]), atEnd: page.follow !== false };
  Object.assign(page, { runs: content.runs, sweeps: content.sweeps, charts: [], maps: [], spectra: [] });
  if (kept.atEnd) page.t = Infinity;
  const parts = [answer(), warnings(), ...sweepSections(), particles(), results(), about(), overTime(), spectra(), cases()];
  document.getElementById("content").replaceChildren(...parts.filter(Boolean));
  const going = page.runs.some((run) => !run.ended);
  document.getElementById("state").textContent = page.runs.length ? (going ? "The run is in progress, or was stopped." : "The run has ended.") : "";
  page.players.forEach((water, k) => { if (kept.views[k] && kept.views[k][1]) { water.resize(); [water.view, water.moved, water.look] = kept.views[k]; } });
  drawLegend();
  show();
  if (window.Plotly) await drawCharts();
  return going || page.sweeps.length > 0;  // a search may add members to a sweep at any time
}

async function loadLibrary(id) {
  const inside = document.getElementById(id);
  if (!inside) return;
  const code = await inflate(bytesOf(inside.textContent.trim()));
  const address = URL.createObjectURL(new Blob([code], { type: "text/javascript" }));
  await new Promise((done, fail) => document.head.append(el("script", { src: address, onload: done, onerror: fail })));
  URL.revokeObjectURL(address);
}

// Asks the local server for updates: of a run until it has ended, of a sweep as long as the server runs.
async function follow() {
  let known = "";
  for (;;) {
    try {
      const answer = await fetch(`record?known=${encodeURIComponent(known)}`);
      if (answer.status === 200) {
        known = answer.headers.get("ETag") || "";
        const going = await take(new Uint8Array(await answer.arrayBuffer()));
        page.taken = (page.taken || 0) + 1;
        if (!going) return;
      } else if (answer.status !== 204) document.getElementById("state").textContent = await answer.text();
    } catch {
      document.getElementById("state").textContent = "The server of this page has ended; the page shows its last contents.";
      return;
    }
    await new Promise((done) => setTimeout(done, 1000));
  }
}

function keys(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || !page.players.length) return;
  if (["INPUT", "SELECT", "TEXTAREA"].includes(event.target.tagName)) return;
  const [first, last] = span(), frame = (last - first) / Math.max(page.players[0].player.t.length - 1, 1);
  const does = {
    " ": () => (event.target.tagName === "BUTTON" || event.target.tagName === "SUMMARY" ? false : play(!page.playing)),
    ArrowRight: () => seek(page.t + frame), ArrowLeft: () => seek(page.t - frame),
    "+": () => zoom(1.4), "-": () => zoom(1 / 1.4), 0: () => { page.players.forEach((water) => water.fit("tank")); show(); },
  }[event.key];
  if (does && does() !== false) event.preventDefault();
}

function zoom(factor) {
  for (const water of page.players) water.zoomBy(factor);
  show();
}

async function begin() {
  if (isDark()) document.documentElement.dataset.theme = "dark";
  document.getElementById("theme").addEventListener("click", () => {
    document.documentElement.dataset.theme = isDark() ? "light" : "dark";
    show();
    drawCharts();
  });
  document.addEventListener("keydown", keys);
  window.addEventListener("resize", () => { if (page.players.length) show(); });
  const inside = document.getElementById("record").textContent.trim();
  try {
    await loadLibrary("three");
    if (inside) await take(bytesOf(inside));
    await loadLibrary("library");
    await drawCharts();
    if (!inside) await follow();
  } catch (error) {
    document.getElementById("state").textContent = `This page could not be shown: ${error.message}. It needs a browser from 2023 or later.`;
    throw error;
  }
}

page.ready = begin();
