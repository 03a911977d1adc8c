// Charts as data: the panels that pictures draw, too; in a view of their own all of them.
const charts = {};
const chartNamed = async (name) => {
  charts.all ||= JSON.parse(await unpack("charts"));
  return charts.all[name];
};
// the panels of a chart; numbers that are columns of its table are there with the rows that they are of
const panelsOf = async (name, scenario = "") => {
  const it = await chartNamed(name), panels = it?.of[scenario] || [], found = panels.length ? await table(it.table) : null;
  for (const panel of panels.known ? [] : panels) {
    panel.series = (panel.series || []).map((s) => {
      const at = placesOf(s.at), failed = placesOf(s.failed), read = (v, rows) => numbersOf(v, rows, found);
      return { ...s, x: read(s.x, at), y: read(s.y, at), low: read(s.low, at), high: read(s.high, at), crosses: read(s.crosses, failed), at, failed, found };
    });
    for (const row of panel.rows || []) row.marks = (row.marks || []).map(([mark, steps, v]) => { const at = placesOf(steps); return [mark, at, numbersOf(v, at, found), found]; });
  }
  panels.known = true;
  return panels;
};
const placesOf = (steps) => {
  const found = [];
  let at = 0;
  for (const step of steps || []) for (let k = 0; k < Math.max(1, -step); k += 1) found.push(at += step < 0 ? 1 : step);
  return found;
};
const numbersOf = (v, rows, found) => (typeof v === "string" ? rows.map((i) => found.columns[v]?.[i] ?? null) : v || []);
// what a row says of the run behind a point, and of one that failed
const said = (found, i, failed) => {
  if (i === undefined) return [];
  const r = (column) => found.columns[column]?.[i], fit = r("used");
  const parts = [r("control") && `${r("control") === "dt" ? "h" : "rtol"} = ${number(r("value"))}`, failed && (r("failure") || r("reason") || r("status")), !failed && r("repeats") > 1 && `the least of ${r("repeats")} times, median ${seconds(r("wall_time_median_s"))}`];
  return [parts.filter(Boolean).join(": "), fit === true && "in the fit", fit === false && !failed && `not in the fit: ${r("reason") || ""}`].filter(Boolean);
};

const KINDS_OF_SCALE = { log: "log", zero: "zerolog", linear: "linear", share: "linear" };
const tick = (v) => (v < 1e-3 && Number.isInteger(+Math.log10(v).toFixed(9)) ? power(Math.round(Math.log10(v))) : number(v));
const axisOf = ({ label, scale, domain, better }, arrows) => {
  const kind = KINDS_OF_SCALE[scale], [low, high] = domain && known(domain[0]) ? domain : [1, 10], way = better ? ` ${arrows[better]} better` : "";
  return { kind, label: label ? label + way : "", domain: scale === "share" ? [low, high] : padded(kind === "linear" ? kind : "log", [low, high]), text: kind === "log" ? tick : null, told: scale === "share" ? (v) => shownIn(v, scale) : null };
};
// a panel of these methods alone; its axes reach over them
const onlyOf = (panel, names) => {
  const series = panel.series.filter((s) => names.has(s.name)), values = (which) => series.flatMap((s) => (which === "y" ? [...s.y, ...(s.low || []), ...(s.high || [])] : s.x)).filter(known).map((v) => (panel.largest && which === "y" ? Math.abs(v) : v));
  const axis = (which) => ({ ...panel[which], domain: extent(values(which).filter((v) => v > 0 || panel[which].scale === "linear")) });
  return series.some((s) => s.x.length) ? { ...panel, series, x: axis("x"), y: axis("y") } : { ...panel, series };
};
const shownIn = (v, scale) => (scale === "share" ? `${number(100 * v)} %` : number(v));
// shown: the names in colour; toggled(name, shown) when one is chosen; named: names stand in the margin; why(name): of a run that failed
const panelChart = (panel, width, height, options = {}) => {
  const drawing = panelDrawing(panel, width, height, options);
  return drawing.tagName === "svg" ? el("div", { class: "picture" }, drawing, saved(panel, drawing)) : drawing;
};
// a chart as a file: its look is written into the SVG, which has no sheet of styles; a PNG is three times as large
const KEPT = ["fill", "stroke", "stroke-width", "stroke-dasharray", "opacity", "font-family", "font-size", "font-weight", "paint-order", "display"];
const plainColour = (v) => v.replace(/color\(srgb ([^)]+)\)/g, (_, parts) => { const [r, g, b, a] = parts.split(/[ /]+/).map(Number); return `rgb(${[r, g, b].map((c) => Math.round(255 * c)).join(",")}${a === undefined ? "" : `,${a}`})`; });
const asSVG = (svg) => {
  const copy = svg.cloneNode(true), own = [svg, ...svg.querySelectorAll("*")];
  [copy, ...copy.querySelectorAll("*")].forEach((e, i) => {
    const style = getComputedStyle(own[i]);
    for (const name of KEPT) e.setAttribute(name, plainColour(style.getPropertyValue(name)));
    for (const name of ["class", "style", "tabindex"]) e.removeAttribute(name);
  });
  copy.prepend(shape("rect", { width: "100%", height: "100%", fill: getComputedStyle(document.body).backgroundColor }));
  return new XMLSerializer().serializeToString(copy);
};
const asPNG = async (svg, name) => {
  const image = new Image(), { width, height } = svg.viewBox.baseVal, canvas = el("canvas", { width: 3 * width, height: 3 * height });
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(asSVG(svg))}`;
  await image.decode();
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  canvas.toBlob((blob) => download(name, [blob], "image/png"));
};
const pointsOf = (panel) => (panel.rows ? panel.rows.flatMap((r) => r.marks.flatMap(([m, , places]) => places.map((x) => [r.name, panel.keys?.[m] || m, x])))
  : panel.series.flatMap((s) => [...s.x.map((x, i) => [s.name, x, s.y[i], s.low[i], s.high[i]]), ...s.crosses.map((x) => [s.name, x, "failed"])]));
const saved = (panel, svg) => {
  const name = [svg.getAttribute("aria-label"), panel.title || panel.y.label].filter((t, i, all) => t && all.indexOf(t) === i).join(" ").replace(/[^\w.-]+/g, "_").slice(0, 60) || "chart";
  const heads = panel.rows ? ["method", "mark", panel.x.label] : ["method", panel.x.label, panel.y.label || panel.title, "low", "high"];
  const button = (text, to) => el("button", { type: "button", title: `Save this chart as ${text}`, onclick: to }, text);
  return el("details", { class: "save" }, el("summary", { title: "Save this chart" }, "⤓"),
    button("SVG", () => download(`${name}.svg`, [asSVG(svg)], "image/svg+xml")), button("PNG", () => asPNG(svg, `${name}.png`)),
    button("CSV", () => download(`${name}.csv`, [asCSV(heads, pointsOf(panel))], "text/csv")));
};
const panelDrawing = (panel, width, height, { scenario = "", shown = null, toggled = null, named = false, why = () => "", title = panel.title || panel.y.label } = {}) => {
  if (panel.rows) return rowChart(panel, width, title);
  if (panel.note || !panel.series.some((s) => s.x.length || s.crosses.length)) return empty(panel.note || "Nothing was measured here.");
  const front = shown || (panel.fore ? new Set(panel.fore) : leaders(scenario));
  const x = axisOf(panel.x, { less: "←", more: "→" }), y = { ...axisOf(panel.y, { less: "↓", more: "↑" }), errors: panel.errors };
  const value = (s, i) => `${panel.x.label} ${number(s.x[i])}: ${panel.y.scale === "share" ? "" : `${panel.y.label} `}${shownIn(s.y[i], panel.y.scale)}${known(s.low[i]) ? ` (${shownIn(s.low[i], panel.y.scale)} to ${shownIn(s.high[i], panel.y.scale)})` : ""}`;
  const series = panel.series.map((s) => {
    let most = 0;  // the largest so far: a line that can be read
    const points = s.x.map((v, i) => ({ x: v, y: panel.largest && known(s.y[i]) ? (most = Math.max(most, Math.abs(s.y[i]))) : s.y[i], low: s.low[i], high: s.high[i], hollow: s.marks === "hollow", tell: () => [value(s, i), ...said(s.found, s.at[i])] }));
    const last = s.ended ? points.findLast((p) => known(p.y)) : null, fore = s.plain || front.has(s.name);
    const crosses = s.crosses.map((v, i) => ({ x: v ?? x.domain[1], tell: () => [`failed${known(v) ? ` at ${panel.x.label} ${number(v)}` : ""}`, ...said(s.found, s.failed[i], true)] }));
    return { name: s.name, label: s.text || (s.line ? s.name : ""), fore, stepped: panel.stepped, colour: s.plain ? "var(--text)" : undefined, dots: !s.line, points,
      crosses: last ? [{ x: last.x, y: last.y, tell: () => [`ended at ${number(last.x)}: ${why(s.name) || "failed"}`] }] : fore ? crosses : crosses.slice(0, 1) };
  });
  return lines(width, height, { series, x, y, toggled: toggled && ((name) => toggled(name, front)), title, ...(named ? marginFor(series) : {}) });
};
// names in the right margin, as wide as the longest of them
const marginFor = (series) => ({ beside: true, margin: { right: 24 + 6.4 * Math.max(0, ...series.filter((s) => s.fore).map((s) => short(s.label, 24).length)) } });

// methods below each other: bars, and marks on them
const SIGNS = { o: "●", ".": "•", s: "■", "^": "▲", D: "◆", ">": "▶", x: "×", _: "|" };  // letters are themselves
const keysOf = (panel) => Object.entries(panel.keys || {}).map(([m, text]) => `${SIGNS[m] || m} ${text}`).join("; ");
const rowChart = (panel, width, title) => {
  if (!panel.x.domain) return empty("Nothing was measured here.");
  const all = panel.rows, left = Math.min(150, 14 + 6.6 * Math.max(...all.map((r) => short(r.name, 20).length)));
  const row = all.length > 30 ? 11 : Math.max(8, Math.min(18, 214 / all.length)), height = row * all.length + 34, small = Math.min(11, row);
  const f = frame(width, height, { x: axisOf(panel.x, { less: "←", more: "→" }), y: { kind: "none" }, title, margin: { left, right: 74, top: 4, bottom: 30 } }), X = (v) => (known(v) ? f.X(v) : left);
  all.forEach((r, i) => {
    const y = 4 + row * (i + 0.5), end = X(r.bar?.[1]), group = shape("g", { class: "bar", style: `--own:${colour(r.name)}` });
    group.append(shape("rect", { class: "hit", x: 0, y: y - row / 2, width, height: row }), shape("text", { x: left - 6, y: y + 4, "text-anchor": "end", "font-size": small }, short(r.name, 20)));
    if (!r.bar && !r.marks.some(([, , v]) => v.some(known)) && r.marks.length) { group.append(shape("text", { class: "soft", x: left + 6, y: y + 4, "font-size": small }, r.text || "no answer")); r = { ...r, marks: [], text: "" }; }
    if (r.bar) group.append(shape("line", { class: "thick", x1: X(r.bar[0]), x2: end, y1: y, y2: y }));
    if (r.dotted) group.append(shape("line", { class: "dotted", x1: end, x2: X(r.dotted), y1: y, y2: y }));
    for (const [m, , places] of r.marks) for (const v of places) if (known(v)) group.append(markAt(m, X(v), y, r.hollow));
    if (r.text) group.append(shape("text", { class: "soft", x: end + 9, y: y + 4, "font-size": small }, r.text));
    const told = () => [r.name, ...r.marks.flatMap(([m, at, places, found]) => places.map((v, k) => `${found?.columns.scenario?.[at[k]] ?? ""} ${panel.keys?.[m] || ""}: ${number(v)}`.trim())).slice(0, 20)];
    f.svg.append(tipped(fill(shape("a", { href: link({ method: r.name }), "aria-label": told().join("; ") }), {}, [group]), told));
  });
  return f.svg;
};
const markAt = (m, x, y, hollow) => (m === "x" ? shape("path", { class: "cross", d: cross(x, y) })
  : m === "|" || m === "_" ? shape("line", { class: m === "_" ? "tick" : "tick own", x1: x, x2: x, y1: y - 4, y2: y + 4 })
    : "BSRP".includes(m) ? shape("text", { class: "letter", x, y: y + 4, "text-anchor": "middle" }, m)
    : shape("path", { class: hollow ? "marker hollow" : "marker", d: MARKS[m === "." ? "o" : m], transform: `translate(${x.toFixed(1)},${y.toFixed(1)}) scale(${m === "." ? 2.2 : 3.2})` }));

const chartsView = async (place) => {
  const root = $("charts-page"), names = page.charts, name = names.includes(place.charts) ? place.charts : names[0];
  const it = await chartNamed(name), there = Object.keys(it.of), scenario = there.includes(place.of) ? place.of : there[0];
  const panels = await panelsOf(name, scenario), keys = keysOf({ keys: Object.assign({}, ...panels.map((p) => p.keys)) });
  root.replaceChildren(el("div", { class: "tools" },
    names.length > 1 ? select("Chart", names.map((n) => [n, n]), name, (n) => { location.hash = link({ charts: n }); }) : "",
    there.length > 1 ? select("scenario", there.map((s) => [s, s]), scenario, (s) => { location.hash = link({ charts: name, of: s }); }) : "",
    again(`tcbench plot ${word(name)} FOLDER${scenario ? ` -s ${word(scenario)}` : ""} -o chart.svg`)),
  el("h2", {}, short(name, 80)), el("p", { class: "soft" }, short(it.text, 300), keys ? ` ${keys}.` : ""));
  root.append(drawnPanels(panels, { scenario, named: true }));
};
// panels side by side, each under its title
const drawnPanels = (panels, options) => el("div", { class: "panels" }, panels.map((panel) => {
  const inside = el("div", { class: "chart" });
  setTimeout(() => drawn(inside, (width) => inside.replaceChildren(panelChart(panel, width, 250, { ...options, named: options.named && width > 340 }))));
  return el("figure", {}, el("figcaption", {}, panel.title), inside);
}));
