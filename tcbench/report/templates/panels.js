// Charts as data: the panels that pictures draw, too. The charts of plugins, in a view of their own.
const charts = {};
const panelsOf = async (name, scenario = "") => {
  charts.all ||= JSON.parse(await unpack("charts"));
  return charts.all[name]?.of[scenario] || [];
};
const KINDS_OF_SCALE = { log: "log", zero: "zerolog", linear: "linear", share: "linear" };
const axisOf = ({ label, scale, domain }) => {
  const kind = KINDS_OF_SCALE[scale], [low, high] = domain || [1, 10];
  return { kind, label, domain: scale === "share" ? [low, high] : kind === "linear" ? padded(kind, [low, high]) : padded("log", [low, high]), text: kind === "log" ? number : null };
};
const shownIn = (v, scale) => (scale === "share" ? `${number(100 * v)} %` : number(v));
// shown: the names in colour; toggled(name, shown) when one is chosen; named: names stand in the margin
const panelChart = (panel, width, height, { scenario = "", shown = null, toggled = null, named = false, title = panel.title || panel.y.label } = {}) => {
  if (panel.note || !panel.series.some((s) => s.x)) return empty(panel.note || "Nothing was measured here.");
  const front = shown || (panel.fore ? new Set(panel.fore) : leaders(scenario));
  const x = axisOf(panel.x), y = { ...axisOf(panel.y), errors: panel.errors };
  const series = panel.series.map((s) => ({
    name: s.name, fore: s.plain || front.has(s.name), stepped: panel.stepped, colour: s.plain ? "var(--text)" : undefined, dots: !s.line || s.marks === "hollow",
    points: (s.x || []).map((v, i) => ({ x: v, y: s.y[i], low: s.low?.[i], high: s.high?.[i], hollow: s.marks === "hollow", tell: () => [
      `${panel.x.label} ${number(v)}: ${shownIn(s.y[i], panel.y.scale)}${known(s.low?.[i]) ? ` (${shownIn(s.low[i], panel.y.scale)} to ${shownIn(s.high[i], panel.y.scale)})` : ""}`] })),
    crosses: (s.crosses || []).map((v) => ({ x: v ?? x.domain[1], tell: () => [`failed${known(v) ? ` at ${panel.x.label} ${number(v)}` : ""}`] })),
  }));
  return lines(width, height, { series, x, y, toggled: toggled && ((name) => toggled(name, front)), title, ...(named ? marginFor(series) : {}) });
};

const chartsView = async (place) => {
  const root = $("charts-page"), names = page.charts.map((c) => c.name), name = names.includes(place.charts) ? place.charts : names[0];
  await panelsOf(name);
  const it = charts.all[name], there = Object.keys(it.of), scenario = there.includes(place.of) ? place.of : there[0];
  root.replaceChildren(el("div", { class: "tools" },
    names.length > 1 ? select("Chart", names.map((n) => [n, n]), name, (n) => { location.hash = link({ charts: n }); }) : "",
    there.length > 1 ? select("scenario", there.map((s) => [s, s]), scenario, (s) => { location.hash = link({ charts: name, of: s }); }) : "",
    again(`tcbench plot ${word(name)} FOLDER${scenario ? ` -s ${word(scenario)}` : ""} -o chart.svg`)),
  el("h2", {}, short(name, 80)), el("p", { class: "soft" }, short(it.text, 300)));
  for (const panel of it.of[scenario]) {
    const inside = el("div", { class: "chart" });
    root.append(el("figure", {}, el("figcaption", {}, panel.title), inside));
    drawn(inside, (width) => inside.replaceChildren(panelChart(panel, width, 300, { scenario })));
  }
};
