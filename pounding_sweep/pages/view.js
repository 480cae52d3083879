// Draws a cube: reads its packed values and shows them where the controls of the page stand.

const $ = (id) => document.getElementById(id);
const cube = JSON.parse($("cube").textContent);
const { dims, fields, scenario_dims: scenarioDims } = cube;
const innerDims = Object.keys(dims).filter((dim) => !scenarioDims.includes(dim));
const size = (dim) => dims[dim].values.length;
const range = (n) => Array.from({ length: n }, (_, i) => i);
const isText = (values) => values.some((value) => typeof value === "string");
const MOST_ROWS = 25;
const ORDERS = { size: Math.abs, largest: (value) => value, smallest: (value) => -value }; // the larger, the worse
const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c6bb1", "#999999"];

// --- values ---

async function unpack(name) {
  const element = [...document.scripts].find((script) => script.dataset.name === name);
  const text = atob(element.textContent);
  const packed = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) packed[i] = text.charCodeAt(i);
  element.remove();
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const loaded = {};
async function load(name) {
  if (!fields[name] || loaded[name]) return; // else its element has gone
  const bytes = await unpack(name);
  const n = bytes.length / 4;
  const bits = new Uint32Array(n);
  for (let i = 0; i < n; i++) {
    bits[i] = bytes[i] | (bytes[n + i] << 8) | (bytes[2 * n + i] << 16) | (bytes[3 * n + i] << 24);
  }
  loaded[name] = new Float32Array(bits.buffer);
}

for (const field of Object.values(fields)) {
  field.step = {};
  field.dims.reduceRight((step, dim) => {
    field.step[dim] = step;
    return step * size(dim);
  }, 1);
}

// Return what reads a field at an offset along the axes `across`. Of others the value is the one of `at`; where that is
// -1, of all buildings, pairs or storeys, the first in an order, and `where` receives its place.
function reader(name, at, across = [], order = ORDERS.size) {
  const { step, dims: own } = fields[name];
  let places = [0];
  for (const dim of own.filter((each) => !across.includes(each))) {
    const indices = at[dim] < 0 ? range(size(dim)) : [at[dim]];
    places = places.flatMap((place) => indices.map((i) => place + i * step[dim]));
  }
  return (offset = 0, where = {}) => {
    let best = NaN;
    for (const place of places) {
      const value = loaded[name][offset + place];
      if (order(value) > order(best) || Number.isNaN(best)) {
        best = value;
        where.place = offset + place;
      }
    }
    return best;
  };
}

const offset = (name, place) =>
  Object.entries(place).reduce((sum, [dim, i]) => sum + i * (fields[name].step[dim] ?? 0), 0);
const placeOf = (name, offset, own) =>
  Object.fromEntries(own.map((dim) => [dim, Math.floor(offset / fields[name].step[dim]) % size(dim)]));

// An axis to draw along, its texts as Plotly takes them: a dimension, an input along one, or, without values, an output.
function axisOf(name) {
  const plain = (value) => (typeof value === "string" ? escaped(value) : value);
  if (dims[name]) return { name, dim: name, about: dims[name], values: dims[name].values.map(plain) };
  const { labels, input } = fields[name];
  const values = input ? Array.from(loaded[name], (value) => plain(labels ? labels[value] : value)) : [];
  return { name, dim: dimOf(name), about: fields[name], values };
}

// --- words ---

const number = (value, digits = 6) => (Number.isFinite(value) ? String(Number(value.toPrecision(digits))) : "no value");
const units = ({ units: text }) => (text ? ` ${text.replaceAll(" ", "·")}` : "");
const worded = (about, value) => (typeof value === "string" ? value : number(value) + units(about));
const atAxis = (dim, i) => (isText(dims[dim].values) ? "" : `${dim} `) + worded(dims[dim], dims[dim].values[i]);
const titled = (name, about) => `${about.long_name || name}${about.units ? ` (${units(about).trim()})` : ""}`;
const escaped = (text) => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;");
const quoted = (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\"'\"'")}'`);
const endOf = (code) => cube.statuses.find((end) => end.status === code);

function element(tag, contents, more = {}) {
  const made = Object.assign(document.createElement(tag), more);
  made.append(...contents);
  return made;
}

const cellsOf = (tag, contents) => contents.map((content) => element(tag, [content]));
const tableRow = (tag, contents) => element("tr", cellsOf(tag, contents));

// --- state ---

const at = Object.fromEntries(Object.keys(dims).map((dim) => [dim, scenarioDims.includes(dim) ? 0 : -1]));
const chosen = (id) => $(id).value;
const isMap = () => $("controls").elements.kind.value === "map";
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
let frameRequest = 0;
let searchIsStale = false;
let drawn = []; // of each trace the scenarios of its points

function refresh(place = {}, changesSearch = false) {
  Object.assign(at, place);
  searchIsStale ||= changesSearch;
  cancelAnimationFrame(frameRequest);
  frameRequest = requestAnimationFrame(draw);
}

const dimOf = (name) => (dims[name] ? name : fields[name].dims[0]);
const lacks = (output, name) => !fields[output].dims.includes(dimOf(name));

function showControls() {
  for (const option of $("choices").querySelectorAll(":is(#across, #per, #up) [value]:not([value=''])"))
    option.disabled = lacks(chosen("output"), option.value);
  for (const control of $("controls").querySelectorAll("[data-dim]")) {
    const { dim } = control.dataset;
    control.value = at[dim];
    control.disabled = lacks(chosen("output"), dim);
    if (control.type === "range") {
      const text = worded(dims[dim], dims[dim].values[at[dim]]);
      control.parentElement.querySelector("output").textContent = text;
      control.setAttribute("aria-valuetext", text);
    }
  }
}

// --- figure ---

// Return what reads points of a figure, each with its scenario, and keeps their statuses.
function pointReader(name, across) {
  const [value, status] = [reader(name, at, across), reader("status", at, across)];
  const read = (place, x, y) => {
    const raw = value(offset(name, place));
    const z = Number.isFinite(raw) ? raw : null;
    const code = status(offset("status", place));
    read.codes.push(code);
    read.hasValue ||= z !== null;
    return { place, code, x, y: y ?? z, z };
  };
  return Object.assign(read, { codes: [], hasValue: false, note: "" });
}

// Points that are not ok say so themselves.
function traceOfBad(name, points, more) {
  const text = points.map(({ place, code, z }) => {
    const words = Object.entries(place).map(([dim, i]) => atAxis(dim, i));
    return [...words, `${name}: ${worded(fields[name], z)}`, `status: ${endOf(code).label}`].map(escaped).join("<br>");
  });
  return { ...traceOf(points, more), text, hovertemplate: "%{text}<extra></extra>" };
}

const traceOf = (points, more) => ({
  ...Object.fromEntries(["x", "y", "place"].map((key) => [key, points.map((point) => point[key])])),
  ...{ type: points.length > 10000 ? "scattergl" : "scatter", mode: "markers", ...more },
});
const marker = (symbol, size) => ({ symbol, size, color: css("--alarm"), line: { width: 2 } });
const hoverLine = (axis, key) =>
  `${escaped(axis.name)} %{${key}${isText(axis.values) ? "" : ":.6~g"}}${escaped(units(axis.about))}`;

// The lines of a figure: what each is of, the indices of its points, and where they are on another axis.
function groupsOf(per, x, read) {
  const all = range(size(x.dim));
  if (!per) return [{ label: "", indices: all, place: {} }];
  if (per.dim === x.dim) {
    const of = (label) => all.filter((i) => per.values[i] === label);
    return [...new Set(per.values)].map((label) => ({ label, indices: of(label), place: {} }));
  }
  const n = size(per.dim);
  const few = Math.min(n, cube.most_lines);
  if (few < n) read.note = `${few} of ${n} values of ${per.name} have a line`;
  const some = range(few).map((k) => Math.round((k * (n - 1)) / Math.max(1, few - 1)));
  return some.map((j) => ({ label: per.values[j], indices: all, place: { [per.dim]: j } }));
}

function lines(name, x, per) {
  const read = pointReader(name, [x.dim, per?.dim]);
  const groups = groupsOf(per, x, read);
  const y = axisOf(name);
  const labelOf = (label) => (per ? worded(per.about, label) : name);
  const bad = [];
  const traces = groups.map(({ label, indices, place }, k) => {
    const hue = 260 - (230 * k) / Math.max(1, groups.length - 1);
    const color = per && !isText(per.values) ? `hsl(${hue} 65% 50%)` : COLOURS[k % COLOURS.length];
    const points = indices.map((i) => read({ [x.dim]: i, ...place }, x.values[i]));
    bad.push(...points.filter((point) => point.code));
    const hovertemplate = `${hoverLine(x, "x")}<br>${hoverLine(y, "y")}<extra>${labelOf(label)}</extra>`;
    const mode = x.name !== x.dim || isText(x.values) ? "markers" : "lines+markers";
    return traceOf(points, { name: labelOf(label), mode, hovertemplate, marker: { color, size: 5 }, line: { color } });
  });
  const known = bad.filter((point) => point.z !== null);
  const lost = bad.filter((point) => point.z === null).map((point) => ({ ...point, y: 0.02 }));
  traces.push(traceOfBad(name, known, { name: "not ok", marker: marker("circle-open", 11) }));
  traces.push(traceOfBad(name, lost, { name: "no value", yaxis: "y2", marker: marker("x-thin-open", 11) }));
  const legend = { orientation: "h", y: -0.25, title: { text: per ? `${escaped(per.name)} ` : "" } };
  const yaxis2 = { overlaying: "y", range: [0, 1], visible: false, fixedrange: true };
  return [traces.filter((trace) => trace.x.length), { yaxis: axisLayout(y, "logy"), yaxis2, legend }, read];
}

function map(name, x, y) {
  const read = pointReader(name, [x.dim, y.dim]);
  const isScatter = x.dim === y.dim;
  const place = (i, j) => (isScatter ? { [x.dim]: i } : { [x.dim]: i, [y.dim]: j });
  const rows = (isScatter ? [0] : range(size(y.dim))).map((j) =>
    range(size(x.dim)).map((i) => read(place(i, j), x.values[i], y.values[isScatter ? i : j])),
  );
  const cell = isScatter ? 12 : Math.max(5, Math.min($("figure").clientWidth / size(x.dim), 300 / size(y.dim)) / 1.5);
  const colorbar = { title: { text: units(fields[name]).trim() }, thickness: 14, outlinewidth: 0 };
  const [z, places] = ["z", "place"].map((key) => rows.map((row) => row.map((point) => point[key])));
  const height = hoverLine(axisOf(name), isScatter ? "marker.color" : "z");
  const hovertemplate = `${hoverLine(x, "x")}<br>${hoverLine(y, "y")}<br>${height}<extra></extra>`;
  const shown = isScatter
    ? traceOf(rows[0], { marker: { colorscale: "Viridis", colorbar, color: z[0], size: 8 }, hovertemplate })
    : { x: x.values, y: y.values, z, place: places, type: "heatmap", hovertemplate, colorscale: "Viridis", colorbar };
  const bad = rows.flat().filter((point) => point.code);
  const hatched = traceOfBad(name, bad, { marker: marker(isScatter ? "circle-open" : "line-ne-open", cell) });
  return [[shown, hatched], { yaxis: axisLayout(y, "logy") }, read];
}

function axisLayout(axis, log) {
  const type = isText(axis.values) ? "category" : $(log).checked ? "log" : "linear";
  const [gridcolor, linecolor] = [css("--line"), css("--soft")];
  const title = { text: escaped(titled(axis.name, axis.about)), standoff: 8 };
  return { type, title, gridcolor, zerolinecolor: gridcolor, linecolor, automargin: true };
}

// What frames the scenario at the sliders; corners are pixels about it.
function frame(xanchor, yanchor) {
  const isDrawn = [xanchor, yanchor].every((value) => typeof value === "string" || Number.isFinite(value));
  const look = { type: "path", path: "M-8,-8 L8,-8 L8,8 L-8,8 Z", line: { color: css("--ink"), width: 2 } };
  return isDrawn ? [{ xanchor, yanchor, xsizemode: "pixel", ysizemode: "pixel", ...look }] : [];
}

let figureKey = "";
function drawFigure(name) {
  const x = axisOf(chosen("across"));
  const other = chosen(isMap() ? "up" : "per");
  const second = other && (isMap() || other !== x.name) ? axisOf(other) : null;
  const up = isMap() ? second.values[at[second.dim]] : reader(name, at)();
  const shapes = frame(x.values[at[x.dim]], up);
  const choices = [...$("choices").elements].map((each) => [each.value, each.checked]);
  const places = Object.entries(at).filter(([dim]) => dim !== x.dim && dim !== second?.dim);
  const key = JSON.stringify([choices, places, css("--ink")]);
  if (key === figureKey) return Plotly.relayout("figure", { shapes });
  figureKey = key;
  const [traces, more, read] = (isMap() ? map : lines)(name, x, second);
  drawn = traces.map((trace) => trace.place);
  const [paper_bgcolor, color] = ["rgba(0,0,0,0)", css("--ink")];
  const font = { color, family: "system-ui, sans-serif", size: 12 };
  const modebar = { bgcolor: paper_bgcolor, color: css("--soft"), activecolor: color };
  const margin = { l: 50, r: 12, t: 30, b: 40 };
  const look = { paper_bgcolor, plot_bgcolor: paper_bgcolor, font, modebar, margin, hovermode: "closest" };
  const drawing = { ...more, shapes, showlegend: traces.length > 1 && !isMap(), xaxis: axisLayout(x, "logx") };
  const modeBarButtons = [["toImage", "zoom2d", "pan2d", "resetScale2d"]];
  Plotly.react("figure", traces, { ...look, ...drawing }, { responsive: true, modeBarButtons, displaylogo: false });
  const ends = cube.statuses.map((end) => [read.codes.filter((code) => code === end.status).length, end]);
  const bad = ends.filter(([n, end]) => n && end.status).map(([n, end]) => `${n} ${end.label}`);
  const how = isMap() ? "hatched or ringed" : "ringed, those without a value as crosses at the foot";
  const equal = [x, second].filter((axis) => axis && lacks(name, axis.name)).map((axis) => axis.name);
  const notes = [read.hasValue ? "" : `${name} has no value here`, read.note];
  if (equal.length) notes.push(`${name} has no axis ${equal.join(" and ")}: values along it are equal`);
  if (bad.length) notes.push(`Of ${read.codes.length} points ${bad.join(", ")}: ${how}`);
  $("note").textContent = notes.filter(Boolean).join(". ");
}

// --- the row, the scenario, the worst ones ---

function drawRow(output) {
  const ownerOf = (name) => Object.keys(cube.spots).find((dim) => fields[name]?.dims.includes(dim));
  const name = [output, "impact_force_max"].find(ownerOf);
  if (!$("row") || !name) return;
  $("row-shows").textContent = titled(name, fields[name]);
  const owner = ownerOf(name);
  const byStorey = fields[name].dims.includes("storey");
  const marks = cube.spots[owner].flatMap((spot, k) =>
    range(byStorey ? size("storey") : 1).map((i) => {
      const storey = byStorey ? dims.storey.values[i] : 1;
      const y = !byStorey ? spot.top : owner === "pair" ? spot.floors[i] : spot.floors[storey - 1];
      const title = `${dims[owner].values[k]}${byStorey ? `, storey ${storey}` : ""}`;
      return { x: spot.x, y, title, value: reader(name, { ...at, [owner]: k, storey: i })() };
    }),
  );
  const shown = marks.filter(({ y, value }) => y != null && Number.isFinite(value));
  const largest = Math.max(...shown.map(({ value }) => Math.abs(value))) || 1;
  const drawing = shown.map(({ x, y, value, title }) => {
    const r = value ? 3 + 17 * Math.sqrt(Math.abs(value) / largest) : 0;
    const text = `<text x="${x}" y="${y - 5}">${number(value, 3)}</text>`;
    return `<g><circle cx="${x}" cy="${y}" r="${r}"/>${text}<title>${escaped(title)}: ${worded(fields[name], value)}</title></g>`;
  });
  $("marks").innerHTML = drawing.join("");
}

function drawScenario() {
  const end = endOf(reader("status", at)());
  const code = end.label === "unsettled" && fields.unsettled_output ? reader("unsettled_output", at)() : 0;
  const which = code ? ` (${fields.unsettled_output.labels[code]})` : "";
  $("status").textContent =
    `Status: ${end.label}${which}: ${end.meaning}${end.remedy ? `. Remedy: ${end.remedy}` : ""}.`;
  $("status").className = end.label === "ok" ? "" : "alarm";
  const error = fields.error_estimate ? reader("error_estimate", at)() : NaN;
  const asked = cube.accuracy ? `; at most ${cube.accuracy} was asked for` : "";
  $("error").textContent = Number.isFinite(error)
    ? `Estimated relative error of its outputs: ${number(error, 2)} (${number(100 * error, 2)} %)${asked}.`
    : `No error was estimated for this scenario. Of the cube: ${cube.errors || "none"}.`;
  for (const cell of document.querySelectorAll("[data-input]")) {
    const name = cell.dataset.input;
    const { labels, dims: own } = fields[name] ?? { dims: [] };
    const inner = own.find((dim) => innerDims.includes(dim));
    const read = (i) => reader(name, { ...at, [inner]: i })();
    const text = (i) => (labels ? labels[read(i)] : worded(fields[name], read(i)));
    if (dims[name]) cell.textContent = worded(dims[name], dims[name].values[at[name]]);
    else if (inner) cell.textContent = dims[inner].values.map((value, i) => `${value} ${text(i)}`).join(", ");
    else cell.textContent = text(0);
  }
  for (const row of document.querySelectorAll("[data-result]")) {
    const name = row.dataset.result;
    const where = {};
    const value = reader(name, { ...at, building: -1, pair: -1, storey: -1 })(0, where);
    const inner = innerDims.filter((dim) => fields[name].dims.includes(dim));
    const words = Object.entries(placeOf(name, where.place, inner)).map(([dim, i]) => atAxis(dim, i));
    row.cells[1].textContent = worded(fields[name], value);
    row.cells[2].textContent = Number.isFinite(value) ? words.join(", ") : "";
  }
  const choice = cube.chosen.map((dim) => ` --at ${quoted(`${dim}=${dims[dim].values[at[dim]]}`)}`);
  if (cube.command) $("command").textContent = `${cube.command}${choice.join("")} -o one.nc`;
}

function drawWorst(name) {
  const order = ORDERS[chosen("order")];
  const read = reader(name, { ...at, ...Object.fromEntries(scenarioDims.map((dim) => [dim, 0])) }, [], order);
  const step = fields[name].step[scenarioDims.at(-1)];
  const worst = [];
  for (let i = 0; i < cube.scenarios; i++) {
    const value = order(read(i * step));
    if (!(value > (worst.length < MOST_ROWS ? -Infinity : worst.at(-1).value))) continue;
    const run = loaded.run?.[i];
    if (run && worst.some((other) => other.run === run)) continue; // one that differs in nothing that counts
    worst.push({ value, i, run });
    worst.sort((one, other) => other.value - one.value);
    worst.length = Math.min(worst.length, MOST_ROWS);
  }
  const axes = scenarioDims.filter((dim) => size(dim) > 1);
  const inputs = scenarioDims.includes("case") ? cube.inputs.filter((each) => !fields[each].labels).slice(0, 6) : [];
  const rows = worst.map(({ i }) => {
    const place = placeOf("status", i, scenarioDims);
    const button = element("button", [worded(fields[name], read(i * step))], { onclick: () => refresh(place) });
    const cells = axes.map((dim) => worded(dims[dim], dims[dim].values[place[dim]]));
    cells.push(...inputs.map((each) => worded(fields[each], loaded[each][i])), endOf(loaded.status[i]).label);
    return tableRow("td", [button, ...cells]);
  });
  $("worst-title").textContent = `Worst scenarios by ${fields[name].long_name}`;
  $("worst").replaceChildren(tableRow("th", [name, ...axes, ...inputs, "status"]), ...rows);
  return worst[0] && placeOf("status", worst[0].i, scenarioDims);
}

function draw() {
  const name = chosen("output");
  showControls();
  drawFigure(name);
  drawRow(name);
  drawScenario();
  if (searchIsStale) drawWorst(chosen("by") || name);
  searchIsStale = false;
}

// --- start ---

document.head.append(element("script", [new TextDecoder().decode(await unpack("plotly"))]));
await Promise.all(["status", "run", cube.output, ...cube.inputs].map(load));
Object.assign(at, drawWorst(cube.output));
showControls();
drawFigure(cube.output);
document.body.dataset.drawn = Math.round(performance.now());
await Promise.all(Object.keys(fields).map(load));
draw();
document.addEventListener("input", ({ target: { dataset, value } }) =>
  refresh(dataset.dim ? { [dataset.dim]: Number(value) } : {}, !scenarioDims.includes(dataset.dim)),
);
$("figure").on("plotly_click", ({ points: [{ pointIndex, curveNumber }] }) =>
  refresh([pointIndex].flat().reduce((places, i) => places[i], drawn[curveNumber])),
);
$("copy")?.addEventListener("click", async () => {
  await navigator.clipboard.writeText($("command").textContent).catch(() => {
    getSelection().selectAllChildren($("command"));
    document.execCommand("copy");
  });
  $("copy").textContent = "Copied";
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => refresh());
document.body.dataset.ready = Math.round(performance.now());
