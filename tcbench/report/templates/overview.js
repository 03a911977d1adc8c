// Overview: methods x scenarios through a lens, speed against accuracy, how large a step may be.
const LENSES = {
  "time 0.001": ["time to an error of 10⁻³, over the best", "time"],
  "time 1e-06": ["time to an error of 10⁻⁶, over the best", "time"],
  "time 1e-09": ["time to an error of 10⁻⁹, over the best", "time"],
  "time energy 1e-12": ["time to an energy error of 10⁻¹², over the best", "time"],
  coarse: ["error of the final temperatures at the coarsest step", "wrong"],
  produced: ["error of the entropy produced at the coarsest step", "wrong"],
  energy: ["largest energy error at the scenario's step, over V₀", "small"],
  step: ["largest stable step h", "step"],
  cost: ["microseconds a step", "cost"],
};
// methods by property: what they are, and what they kept in this run
const PROPERTIES = {
  "": ["all", () => true], lawful: ["that kept every law here", lawful], fixed: ["of a fixed step", (m) => m.kind && m.kind !== "adaptive"], adaptive: ["that choose their steps", (m) => m.kind === "adaptive"],
  explicit: ["explicit", (m) => told[m.name]?.tags?.includes("explicit")], high: ["of order 3 or more", (m) => (m.order?.median ?? told[m.name]?.order ?? 0) > 2.5],
};
const OF_VIEW = { only: "only", lens: "lens", sorted: "sort", scenario: "on", error: "show", fixed: "fixed", wide: "limits" };
const view = choosing(OF_VIEW, { only: "", lens: null, sorted: null, scenario: null, error: null, fore: null, wide: null, fixed: "" });

const INITIALS = { energy: "E", entropy: "S", angular_momentum: "J" };
const dots = (laws) => el("span", { class: "dots" }, laws.map((law) => {
  const share = law.of ? law.kept / law.of : 0;
  const size = !law.of ? "none" : share === 1 ? "all" : share >= 0.5 ? "most" : share > 0 ? "few" : "no";
  const said = law.claimed === null ? "" : law.claimed ? "claimed; " : "not claimed; ";
  const text = law.of ? `${said}kept in ${law.kept} of ${law.of} runs` : `${said}not measured: no run has it`;
  return el("span", { class: `dot ${size}${law.claimed === false ? " unclaimed" : ""}`, title: `${words(law.law)}: ${text}` });
}));
const without = (m, text, none) => (m.kind === "adaptive" ? text : none);  // of what only methods with a fixed step have
const orderText = (m) => (m.order ? (known(m.order.median) ? m.order.low.toFixed(1).replace(/\.0$/, "") : "?") : without(m, "·", ""));
const orderTip = (m) => (!m.order ? without(m, "no fixed step", "not measured") : !m.order.of ? "the steps show no order"
  : `fitted order ${m.order.low.toFixed(2)} to ${m.order.high.toFixed(2)} on ${m.order.of} scenarios; declared ${m.order.declared ?? "none"}`);
const stepText = (m) => (!m.step || !m.step.of ? without(m, "·", m.step ? "?" : "") : m.step.limited ? (m.step.least ? number(m.step.least, 2) : "none") : `> ${number(m.step.cap, 2)}`);
const stepTip = (m) => (!m.step || !m.step.of ? without(m, "no fixed step", m.step ? "no answer" : "not measured") : m.step.limited
  ? `least of the largest stable steps, on ${m.step.where}; a limit on ${m.step.limited} of ${m.step.of} scenarios`
  : `no limit found on ${m.step.of} scenarios`);

const percent = (v, digits = 2) => (v < ROUND_OFF ? "0" : v < 1e-5 ? "<.001%" : `${number(100 * v, digits)}%`);
const ending = (counts) => Object.entries(page.marks).filter(([m]) => counts?.[m]).map(([m, text]) => `${counts[m]} ${text}`).join(", ") || "none";
const cellText = (kind, value, best, stopped, digits = 2) => {
  if (value === null) return stopped ? "…" : "–";
  if (kind === "time") return value === best ? (digits < 2 ? "1" : "best") : value / best >= (digits < 2 ? 999.5 : 9999.5) ? `${number(value / best / 1000, 2)}k` : number(value / best, value / best < 10 ? 2 : digits + 1);
  if (kind === "step") return Array.isArray(value) ? `> ${number(value[1], digits)}` : number(value, 2);
  if (kind === "wrong") return percent(value, value < 0.0995 ? digits : 2);
  return number(value, kind === "cost" ? 2 : digits);
};
// how strongly a cell is tinted, 1 for the best: better is stronger, and never between where no text could be read
const strength = (kind, value, best) => {
  if (value === null) return 0;
  if (kind === "step") return Array.isArray(value) ? 0.58 : Math.max(0.04, Math.min(0.5, 0.38 + 0.18 * Math.log10(value)));
  if (kind === "wrong") return Math.max(0.03, Math.min(0.5, -Math.log10(value) / 12));
  if (kind === "small") return value <= 1e-9 ? 0.58 : Math.max(0.03, -Math.log10(value) / 18);
  const ratio = Math.log10(value / best);
  return ratio === 0 ? 1 : Math.max(0.05, 0.58 - 0.15 * ratio);
};

const matrix = () => {
  const lens = page.lenses.find((l) => l.key === view.lens), kind = lens ? LENSES[lens.key][1] : "";
  const value = (m, s) => lens?.cells[m]?.[s], stopped = (m, s) => kind === "time" && page.stopped[m]?.[s];
  const best = {}, star = {};
  for (const s of page.scenarios) {
    const found = page.methods.filter((m) => known(value(m.name, s))).sort((a, b) => value(a.name, s) - value(b.name, s));
    best[s] = found.length ? value(found[0].name, s) : null;
    if (kind === "time") star[s] = found.find(lawful)?.name;
  }
  const badness = (m, s) => {
    const v = value(m.name, s);
    if (v === undefined) return Infinity;
    if (v === null) return 1e300;
    return kind === "step" ? -(Array.isArray(v) ? 1e9 : v) : v / (kind === "time" || kind === "cost" ? best[s] : 1);
  };
  const place = Object.fromEntries((lens?.order || []).map((name, i) => [name, i])), mean = (m) => place[m.name] ?? Infinity;
  const by = view.sorted ? (a, b) => badness(a, view.sorted) - badness(b, view.sorted) || (a.name < b.name ? -1 : 1)
    : (a, b) => a.family - b.family || (mean(a) === mean(b) ? 0 : mean(a) - mean(b)) || (a.name < b.name ? -1 : 1);
  const ordered = page.methods.filter((PROPERTIES[view.only] || PROPERTIES[""])[1]).sort(by);
  const head = el("tr", {}, el("th", { scope: "col" }, "method"), el("th", { scope: "col", title: (page.methods[0]?.laws || []).map((l) => words(l.law)).join(", ") }, "laws", page.methods[0]?.laws.length ? " " : "", el("span", { class: "dots letters" }, (page.methods[0]?.laws || []).map((l) => el("span", { class: "dot letter" }, INITIALS[l.law] || "I")))),
    ordered.some((m) => m.order) ? el("th", { scope: "col", title: "lowest fitted order" }, "order") : null,
    ordered.some((m) => m.step) ? el("th", { scope: "col", title: "least of the largest stable steps" }, "h stable") : null,
    page.scenarios.map((s) => el("th", { scope: "col", class: "one", "aria-sort": view.sorted === s ? "ascending" : "none" },
      el("a", { href: link({ scenario: s }), title: `${s}${scenes[s]?.shows ? `: ${scenes[s].shows}` : ""}` }, ...broken(short(s, 34))), " ",
      el("button", { type: "button", title: `${s}: sort by it`, "aria-label": `sort by ${s}`, onclick: () => { act(() => { view.sorted = view.sorted === s ? null : s; }); drawMatrix(); } },
        view.sorted === s ? "▾" : "▿"))));
  const body = [];
  let family = null;
  for (const m of ordered) {
    if (!view.sorted && m.family !== family) {
      family = m.family;
      body.push(el("tr", { class: "family" }, el("th", { colspan: head.children.length, scope: "colgroup" }, page.families[family])));
    }
    body.push(el("tr", {},
      el("th", { scope: "row" }, mark(m.name), el("a", { href: link({ method: m.name }), title: m.name }, short(m.name, 26))),
      el("td", {}, dots(m.laws)), ordered.some((x) => x.order) ? el("td", { title: orderTip(m) }, orderText(m)) : null, ordered.some((x) => x.step) ? el("td", { title: stepTip(m) }, stepText(m)) : null,
      page.scenarios.map((s) => {
        const v = value(m.name, s), failed = page.failures[m.name]?.[s], tint = v === undefined ? 0 : strength(kind, v, best[s]);
        if (v === undefined && !failed) return el("td", { class: "one" });
        const first = star[s] === m.name;
        const cell = el("a", { href: link({ scenario: s, method: m.name, lens: view.lens }), tabindex: -1, class: `cell${failed?.[0] ? " failed" : ""}${tint === 1 ? " strong" : ""}`,
          style: `--tint:${Math.round(100 * tint)}%` }, v === undefined ? " " : cellText(kind, v, best[s], stopped(m.name, s), tight() ? 1 : 2), first ? "✓" : "");
        return el("td", { class: "one" }, tipped(cell, () => [`${m.name} on ${s}`, ...cellTip(kind, v, best[s], stopped(m.name, s)),
          ...(first ? ["✓ first of the methods that kept every law in every run"] : []),
          ...(failed ? [`${failed[0]} of ${failed[1]} runs failed: ${ending(failed[3])}. ${failed[2]}`] : [])]));
      })));
  }
  return el("table", { class: page.scenarios.length > MANY ? "matrix many" : "matrix", style: `--scenarios:${page.scenarios.length}` }, el("thead", {}, head), el("tbody", {}, body));
};
const cellTip = (kind, v, best, stopped) => {
  if (v === undefined) return ["not measured"];
  if (v === null && kind === "time") return [stopped ? `not reached before its ladder ended: ${stopped}` : "not reached on its ladder"];
  if (v === null) return [kind === "step" ? "no stable step found" : "the run failed"];
  if (kind === "wrong") return [`off by ${percent(v)} of what it is`];
  if (kind === "time") return [`${seconds(v)}${v === best ? ", the best here" : `, ${number(v / best, 3)} times the best`}`];
  if (kind === "step") return [Array.isArray(v) ? `no limit found up to h = ${number(v[1])}` : `stable up to h = ${number(v)}`];
  return [kind === "small" ? `|E − E₀| / V₀ up to ${number(v)}` : `${number(v)} µs a step`];
};
const narrow = matchMedia("(max-width: 620px)"), MANY = 9;  // scenarios, above which headings stand upright
const tight = () => narrow.matches || page.scenarios.length > MANY;
narrow.addEventListener("change", () => drawMatrix());
const drawMatrix = () => {
  $("matrix").replaceChildren(matrix());
  $("matrix-note").textContent = { time: "✓ first that keeps every law; – not reached; … stopped early", wrong: "– the run failed; stronger is less wrong", small: "– the run failed; stronger is less lost", step: "> no limit up to there; – none found", cost: "stronger is cheaper" }[LENSES[view.lens]?.[1]] || "";
  $("matrix-note").append(view.lens ? "; " : "");
};
// arrow keys move among the links of a row and between rows
const walk = (event) => {
  const move = { ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowDown: [1, 0], ArrowUp: [-1, 0] }[event.key];
  const cell = event.target.closest?.("th, td"), row = cell?.parentElement;
  if (!move || !row?.closest("tbody")) return;
  event.preventDefault();
  let next = null;
  if (move[1]) {
    const links = [...row.querySelectorAll("a")];
    next = links[links.indexOf(event.target) + move[1]];
  } else {
    const all = [...row.parentElement.children];
    for (let i = all.indexOf(row) + move[0]; all[i] && !next; i += move[0]) next = all[i].children[cell.cellIndex]?.querySelector("a");
  }
  next?.focus();
};

const leaders = (scenario) => new Set(page.leaders[scenario] || page.methods.map((m) => m.name));
const toggle = (name, shown) => {
  view.fore = new Set(shown);
  view.fore[view.fore.has(name) ? "delete" : "add"](name);
  overviewCharts();
};

const drawSpeed = async () => {
  const found = (await chartNamed("work-precision"))?.of, place = $("speed"), controls = $("speed-controls");
  if (!found) { $("speed-panel").hidden = true; return; }
  const there = Object.keys(found), profile_ = view.scenario === "profile", profile = page.tables.performance_profile ? [["profile", "whole ensemble"]] : [];
  if (!profile_ || !profile.length) view.scenario = [view.scenario, page.opening, there[0]].find((s) => there.includes(s));
  const shares = view.scenario === "profile", all = await panelsOf(shares ? "performance-profile" : "work-precision", shares ? "" : view.scenario);
  controls.replaceChildren(
    select("Scenario", [...there.map((s) => [s, s]), ...profile], view.scenario, (s) => { view.scenario = s; view.fore = null; drawSpeed(); }),
    shares ? "" : choose(all, view, drawSpeed), shares ? "" : fixedOnly(view, drawSpeed));
  if (shares) {  // of random starts: the share that a method brings to the target within tau times the best time
    const panel = all.find((p) => p.title.includes("state to 1e-6")) || all[0];
    drawn(place, (width) => place.replaceChildren(panelChart(panel, width, 250, { shown: view.fore, toggled: toggle, named: true, title: "Performance profile over the ensemble" })));
    return;
  }
  drawn(place, (width) => place.replaceChildren(panelChart(ofFixed(chosenOf(all, view), view.fixed), width, width < 500 ? 300 : 236, { scenario: view.scenario, shown: view.fore, toggled: toggle })));
  $("speed-again").replaceChildren(again(`tcbench run -s ${word(view.scenario)} --study work_precision -o mine`, `tcbench plot work-precision mine -s ${word(view.scenario)} -o speed.svg`));
};
// adaptive methods are orders of magnitude ahead, and squeeze those of a fixed step into a bundle
const fixedOnly = (state, changed) => select("of", [["", "all methods"], ["yes", "fixed step only"]], state.fixed || "", (v) => { state.fixed = v; changed(); });
const ofFixed = (panel, fixed) => (fixed ? onlyOf(panel, new Set(panel.series.filter((s) => s.found?.columns.control?.[s.at[0] ?? s.failed[0]] === "dt").map((s) => s.name))) : panel);
// one of several panels, by what its y axis says
const chosenOf = (panels, state) => panels.find((p) => p.y.label === state.error) || panels[0];
const choose = (panels, state, changed) => select("show", panels.map((p) => [p.y.label, p.y.label]), chosenOf(panels, state).y.label, (label) => { state.error = label; changed(); });

const drawSteps = async () => {
  const steps = await panelsOf("stable-step"), [shares] = await panelsOf("failure-share"), place = $("steps"), controls = $("steps-controls");
  $("steps-panel").hidden = !steps.length && !shares;
  if (!steps.length && !shares) return;
  const choices = [...steps.map((p) => [p.title, p.title]), ...(shares ? [["shares", "an ensemble of random starts"]] : [])];
  const now = choices.some(([key]) => key === view.wide) ? view.wide : choices[0][0], panel = now === "shares" ? shares : steps.find((p) => p.title === now);
  controls.replaceChildren(choices.length > 1 ? select("On", choices, now, (v) => { view.wide = v; drawSteps(); }) : "", now === "shares" ? "Of runs from random starts, with 95 % bands." : keysOf(panel));
  const [study, kind] = now === "shares" ? ["ensemble", "failure-share"] : ["stability", "stable-step"];
  $("steps-again").replaceChildren(again(`tcbench run --study ${study} -o mine`, `tcbench plot ${kind} mine -o steps.svg`));
  drawn(place, (width) => place.replaceChildren(panelChart(panel, width, 240, { named: true, title: now === "shares" ? "Failure shares" : "Largest stable step of each method" })));
};
const overviewCharts = () => Promise.all([drawSpeed(), drawSteps()]);

const overview = async (place) => {
  recall(view, OF_VIEW, place);
  const keys = page.lenses.map((l) => l.key);
  const reached = (key) => Object.values(page.lenses.find((l) => l.key === key)?.cells || {}).some((row) => Object.values(row).some(known));
  view.lens = keys.includes(place.lens) ? place.lens : keys.includes(view.lens) ? view.lens : ["time 1e-06", "time 0.001"].find(reached) || keys[0];
  $("matrix-controls").replaceChildren(keys.length
    ? select("Cells:", keys.map((k) => [k, LENSES[k][0]]), view.lens, (k) => { view.lens = k; drawMatrix(); }) : "",
    select("methods", Object.entries(PROPERTIES).filter(([, [, has]]) => page.methods.some(has)).map(([k, [text]]) => [k, text]), view.only, (k) => { view.only = k; drawMatrix(); }));
  if (place.overview === "ensemble") {
    view.wide = "shares";
    if (page.tables.performance_profile) view.scenario = "profile";
  }
  drawMatrix();
  await overviewCharts();
};
$("matrix").addEventListener("keydown", walk);
