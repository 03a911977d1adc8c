// Scenarios, one at a time: what it is, the player, losses in time, its tables; and one method on it.
// the largest step from which on every finer rung is as good as asked, between two rungs; null where not even the finest
const stepFor = (rungs, column, most) => {
  const fine = rungs.filter((r) => r.control === "dt").sort((a, b) => a.value - b.value), off = (r) => (r.status !== "ok" ? Infinity : r[column] ?? (10 * r.reference_floor || 0));  // what the reference hides is small
  const bad = fine.findIndex((r) => !(off(r) <= most)), last = fine[(bad < 0 ? fine.length : bad) - 1], next = fine[bad];
  if (!fine.length) return undefined;
  if (!last) return null;
  const share = next && Number.isFinite(off(next)) && off(last) > 0 ? Math.log(most / off(last)) / Math.log(off(next) / off(last)) : 0;
  return last.value * (next ? next.value / last.value : 1) ** share;
};
const TOLERATED = ["0.1", "0.01", "0.001", "0.0001"];
const OF_SCENARIO = { left: "left", right: "right", loss: "loss", span: "span", step: "step", rank: "by", error: "show", fixed: "fixed", minus: "minus", off: "off" };
const chosenIn = choosing(OF_SCENARIO, { methods: null, left: null, right: null, loss: null, span: "opening", fixed: "", minus: "", off: "0.01" });

const MOST_VALUES = 6;  // of an array; of a larger one its size and the range of its numbers
const value = (v) => {
  if (!Array.isArray(v)) return known(v) ? number(v, 6) : String(v);
  const flat = v.flat(Infinity), numbers = flat.filter(known), [low, high] = extent(numbers);
  if (flat.length <= MOST_VALUES) return `(${v.map(value).join(", ")})`;
  const sizes = []; for (let part = v; Array.isArray(part); part = part[0]) sizes.push(part.length);
  return `${sizes.join(" × ")} values${numbers.length ? low === high ? `, all ${number(low)}` : `, ${number(low)} to ${number(high)}` : ""}`;
};
const facts = (pairs) => el("dl", {}, pairs.filter(([, v]) => v !== undefined && v !== "" && v !== null)
  .flatMap(([k, v]) => [el("dt", {}, k), el("dd", {}, v instanceof Node ? v : value(v))]));

const about = (name) => {
  const it = scenes[name];
  if (!it) return empty("This folder does not say what the scenario is: run its command again with this version of tcbench.");
  return el("div", {}, el("p", {}, it.shows ? `${it.shows[0].toUpperCase()}${it.shows.slice(1)}.` : ""),
    facts([["system", words(it.system)], ["source", it.source], ...Object.entries(it.constants).map(([k, v]) => [words(k), v]),
      ...Object.entries(it.initial || {}).map(([k, v]) => [`initial ${words(k)}`, v]), ["initial positions", it.positions], ["initial momenta", it.momenta], ["initial temperatures", it.temperatures],
      ["ends at t", it.t_end], ["its own step h", it.dt], ["initial exergy V₀", it.initial_exergy], ["a run fails beyond", `|E − E₀| = ${number(it.blowup_factor)} V₀`]]));
};

// a method that fails or loses most, beside a consistent one
const pair = (runs, wanted) => {
  const names = runs.map((r) => r.name), bad = (r) => (r.failure ? 1e300 : Math.max(0, ...r.states.map((s) => s.energy_error).filter(known)));
  const ranked = [...runs].sort((a, b) => bad(b) - bad(a)), own = ranked.find((r) => method[r.name]?.family === 0) || ranked[0];
  const good = ["tc_monolithic", ...page.methods.filter(lawful).map((m) => m.name)].find((n) => names.includes(n) && n !== wanted);
  const left = names.includes(wanted) ? wanted : names.includes(chosenIn.left) ? chosenIn.left : own?.name;
  const right = names.includes(chosenIn.right) && chosenIn.right !== left ? chosenIn.right : good && good !== left ? good : names.find((n) => n !== left);
  return [left, right].filter(Boolean);
};

const runsOf = async (scenario) => {
  const series = rows(await table("series"), { scenario }), ladder = rows(await table("conservation"), { scenario });
  const opening = grouped(rows(await table("opening"), { scenario }), "integrator"), fields = grouped(rows(await table("fields"), { scenario }), "integrator");
  return [...grouped(series, "integrator")].map(([name, states]) => {
    const { dt, tolerance } = states[0], first = opening.get(name) || [];
    const own = ladder.find((r) => r.integrator === name && (known(dt) && dt > 0 ? Math.abs(r.dt / dt - 1) < 1e-9 : r.tolerance === tolerance));
    const frames = [...grouped(fields.get(name) || [], "t")].map(([t, of]) => ({ t, places: of.filter((r) => known(r.x)).map((r) => [r.x, r.y ?? 0, r.z ?? 0]), heat: of.map((r) => r.temperature ?? null) }));
    return { name, states, frames, dt: dt || Infinity, opening: !frames.length && first.length && first.at(-1).t < states.at(-1).t ? first : null,
      failure: own && own.status !== "ok" ? own.failure || own.status : "" };
  });
};
// what the player shows of runs: all of their thin series, or every one of the first steps; of a run that has no such
// steps the same time, if it has enough states there
const shownOf = (runs) => {
  const openings = runs.filter((r) => r.opening), end = 1.0001 * Math.max(...openings.map((r) => r.opening.at(-1).t));
  return runs.map((run) => {
    const record = run.states.filter((s) => s.t <= end), first = run.opening || record;
    if (chosenIn.span === "whole" || !openings.length || first.length < 10) return { ...run, whole: true, record: run.states };
    return { ...run, states: first, record, whole: record.length === run.states.length };
  });
};

// a panel of the differences from one method's line, at the times that both have
const minus = (panel, name) => {
  const first = panel.series.find((s) => s.name === name), at = new Map(first?.x.map((t, i) => [t, first.y[i]]));
  if (!first || panel.y.scale !== "linear") return panel;
  const series = panel.series.filter((s) => s !== first && s.name !== name).map((s) => ({ ...s, y: s.x.map((t, i) => (known(at.get(t)) && known(s.y[i]) ? s.y[i] - at.get(t) : null)) }));
  return { ...panel, series, title: `${panel.title}, less that of ${name}`, y: { ...panel.y, domain: extent(series.flatMap((s) => s.y).filter(known)) } };
};
const losses = async (name, runs, place) => {
  const there = await panelsOf("laws", name), told = await panelsOf("in-time", name);
  if (!there.length) return;
  const far = there.filter((p) => p.title.startsWith("distance from the exact")), laws = there.filter((p) => !far.includes(p)), loss = laws.find((p) => p.title === chosenIn.loss) || laws[0];
  const others = told.some((p) => p.y.scale === "linear") ? runs.map((r) => r.name) : [];
  const only = (p) => { const it = onlyOf(chosenIn.minus ? minus(p, chosenIn.minus) : p, chosenIn.methods); return it.series.length ? it : { ...it, note: "Choose a method above." }; };
  place.replaceChildren(el("div", { class: "tools" }, select("Loss of", laws.map((p) => [p.title, p.title]), loss.title, (c) => { chosenIn.loss = c; losses(name, runs, place); }),
    others.length > 1 ? select("variables: less those of", [["", "none"], ...others.map((n) => [n, n])], chosenIn.minus, (c) => { chosenIn.minus = c; losses(name, runs, place); }) : "",
    again(`tcbench run -s ${word(name)} --study conservation -o mine`, `tcbench plot laws mine -s ${word(name)} -o laws.svg`, `tcbench plot in-time mine -s ${word(name)} -o in_time.svg`)),
  drawnPanels([loss, ...far, ...told].map(only), { shown: chosenIn.methods, named: true, why: (m) => runs.find((r) => r.name === m)?.failure }));
};

// one method on one scenario: every run on its ladders, its order, its step
const together = async (name, scenario, lens, every) => {
  const where = { integrator: name, scenario };
  const counted = (r) => !((r.control && r.control !== "dt" ? r.value : r.tolerance) > page.loose);  // as everywhere that failures are counted
  const [ladder, work, steps, fits] = [rows(await table("conservation"), where).filter(counted), rows(await table("work_precision"), where).filter(counted), rows(await table("stability"), where), rows(await table("convergence"), where)];
  const bad = [...ladder.map((r) => ({ ...r, at: known(r.dt) ? `h = ${number(r.dt)}` : `tolerance ${number(r.tolerance)}` })), ...work.map((r) => ({ ...r, at: `${r.control === "dt" ? "h" : "rtol"} = ${number(r.value)}` }))].filter((r) => r.status && r.status !== "ok");
  const whole = fits.find((r) => r.variable === "all") || fits[0], step = steps[0];
  const parts = numberOf(lens, name, scenario);
  if (whole) parts.push(`Order ${orderWith(whole)}.`);
  if (step?.limit) parts.push(step.limit === "none" ? `No limit of its step found up to h = ${number(step.dt_cap)}.` : `Stable up to h = ${number(step.dt_stable)}; then ${step.limit}: ${LIMITS[step.limit] || ""}${step.cause ? ` (${words(step.cause)})` : ""}.`);
  const runs = ladder.length + work.length;
  parts.push(!runs ? "" : bad.length ? `${bad.length} of its ${runs} runs on the ladders of steps and tolerances failed:` : `All of its ${runs} runs on the ladders of steps and tolerances reached their end.`);
  const once = unique(bad.map((r) => `${r.at}: ${r.failure || r.status}`));
  return el("section", { class: "pair", style: `--own:${colour(name)}`, "aria-label": `${name} on ${scenario}` },
    el("h3", {}, mark(name), el("a", { href: link({ method: name }) }, name), ` on ${scenario}`), parts.filter(Boolean).map((p) => el("p", {}, p)),
    once.length ? el("ul", {}, once.slice(0, 12).map((t) => el("li", {}, short(t, 500)))) : "", once.length > 12 ? el("p", { class: "soft" }, `and ${once.length - 12} more in the table below`) : "", runBehind(lens, name, scenario, every));
};
const LIMITS = { physical: "a solution exists, but energy, temperature or entropy leaves its bounds", positivity: "a temperature or a quantity that must be positive comes to 0", branch: "the branch of solutions ends", solver: "a solution exists, but Newton does not find it" };
const orderWith = (fit) => (known(fit.order) ? `${fit.order.toFixed(2)} (${fit.order_low.toFixed(3)} to ${fit.order_high.toFixed(3)}), declared ${fit.declared ?? "none"}` : `undetermined${fit.note ? `: ${fit.note}` : ""}`);

// what a scenario answers: the sentences, every method ranked, speed against accuracy
const answered = (name) => el("p", { class: "answers" }, (page.answers[name] || []).flatMap(([title, lead, text], i) => [i ? ". " : "", `${title}: `, el("strong", {}, lead), `, ${text}`]), page.answers[name]?.length ? "." : "");
const DEFINED = {
  laws: "each law of the system: in how many of the runs at a series of steps it was kept; sorted by the share of runs that lost one", stable: "the largest step below which no step tried failed; > means that no limit was found up to there",
  failed: "runs that ended badly, over all steps and all tolerances up to 1e-3: B blow-up, S entropy falls, R no root, P a quantity not positive, x no answer", time: "the least wall time in which the error of the state at the end is that small, interpolated between two steps or tolerances; – not reached, … stopped early",
  theta: "largest error of the temperatures at the end (t_compared, where the table has that), relative; of methods with a fixed step", produced: "error of the entropy produced up to there, relative", state: "error of the state at the end, relative to its size",
};
const ranking = (name, wanted, work) => {
  const steps = unique(work.filter((r) => r.control === "dt").map((r) => r.value)).sort((a, b) => b - a), root = el("div", {});
  chosenIn.step = steps.find((h) => +chosenIn.step && Math.abs(h / chosenIn.step - 1) < 0.2) || steps[0];
  const measure = ["error_theta", "error"].find((c) => work.some((r) => known(r[c]))), rungs = grouped(work, "integrator");
  const needed = (m) => (measure && rungs.has(m) ? stepFor(rungs.get(m), measure, +chosenIn.off) : undefined);
  const cells = (key) => page.lenses.find((l) => l.key === key)?.cells || {};
  const draw = () => {
    const at = Object.fromEntries(work.filter((r) => r.control === "dt" && Math.abs(r.value / chosenIn.step - 1) < 1e-6).map((r) => [r.integrator, r]));
    const h = `h = ${number(chosenIn.step)}`, wrong = (column) => (m) => (at[m] ? (at[m].status === "ok" ? at[m][column] ?? undefined : null) : undefined);
    const timed = (key) => (m) => cells(key)[m]?.[name], kept = (m) => page.dots[name]?.[m];
    const columns = [
      ["laws", "laws kept", DEFINED.laws, (m) => (kept(m) ? kept(m).reduce((sum, [, good, of]) => sum + 1 - good / of, 0) : undefined), (v, m) => dots(kept(m).map(([law, good, of, claimed]) => ({ law, kept: good, of, claimed })))],
      ...["0.001", "1e-06", "1e-09"].map((t) => [`time ${t}`, `to ${power(Math.round(Math.log10(+t)))}`, DEFINED.time, timed(`time ${t}`), seconds]),
      ["theta", "θ error", `at ${h}: ${DEFINED.theta}`, wrong("error_theta"), (v) => percent(v)], ["produced", "S error", `at ${h}: ${DEFINED.produced}`, wrong("error_entropy_produced"), (v) => percent(v)],
      ["state", "state error", `at ${h}: ${DEFINED.state}`, wrong("error"), (v) => percent(v)],
      ["needed", `h for ${percent(+chosenIn.off)}`, `the largest step with which the ${measure === "error" ? "state" : "temperatures"} at the end of the run ${measure === "error" ? "is" : "are"} off by no more than ${percent(+chosenIn.off)}, and with every finer one, between two steps`, (m) => { const v = needed(m); return known(v) ? -v : v; }, (v) => number(-v, 2)],
      ["stable", "stable up to h", DEFINED.stable, (m) => { const v = cells("step")[m]?.[name]; return Array.isArray(v) ? -1e9 : known(v) ? -v : v; }, (v) => (v === -1e9 ? `> ${number(cells("step")[Object.keys(cells("step")).find((m) => Array.isArray(cells("step")[m][name]))][name][1], 2)}` : number(-v, 2))],
      ["failed", "ended badly", DEFINED.failed, (m) => Object.values(page.failures[m]?.[name]?.[3] || {}).reduce((a, b) => a + b, 0), (v, m) => (v ? marked(page.failures[m][name][3]) : "0")],
    ].filter(([key, , , get]) => page.methods.some((m) => known(get(m.name))) && (key !== "failed" || page.methods.some((m) => get(m.name) > 0)));
    const there = page.methods.filter((m) => columns.some(([key, , , get]) => key !== "failed" && get(m.name) !== undefined));
    if (!columns.some(([key]) => key === chosenIn.rank)) chosenIn.rank = ["time 1e-06", "time 0.001", "theta", "state", "laws"].find((k) => columns.some(([key]) => key === k)) || columns[0]?.[0];
    if (!columns.length) { root.replaceChildren(empty("This run measured nothing by which methods can be ranked here; its tables are below.")); return; }
    const sorting = columns.find(([key]) => key === chosenIn.rank), tie = columns.find(([key]) => key === "theta" || key === "state");
    const size = (column, m) => { const v = column?.[3](m); return v === undefined ? Infinity : v === null ? 1e300 : v; };
    there.sort((a, b) => size(sorting, a.name) - size(sorting, b.name) || size(tie, a.name) - size(tie, b.name) || (a.name < b.name ? -1 : 1));
    const best = Object.fromEntries(columns.map((c) => [c[0], Math.min(...there.map((m) => c[3](m.name)).filter(known))]));
    root.replaceChildren(
      el("div", { class: "tools" }, measure && steps.length ? select("errors at step", steps.map((s) => [String(s), number(s)]), String(chosenIn.step), (v) => { chosenIn.step = +v; draw(); }) : "",
        measure && steps.length ? select("step for an error of", TOLERATED.map((t) => [t, percent(+t)]), chosenIn.off, (v) => { chosenIn.off = v; draw(); }) : "",
        el("span", { class: "soft" }, "– not reached or failed; … stopped early; blank: not measured. A heading sorts."),
        again(`tcbench run -s ${word(name)} -o mine`, "tcbench report mine")),
      el("div", { class: "scroll ranking", tabindex: 0 }, el("table", { class: "simple rank" },
        el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "method"), columns.map(([key, title, means]) => el("th", { scope: "col", title: means, "aria-sort": key === chosenIn.rank ? "ascending" : "none" },
          el("button", { type: "button", onclick: () => { act(() => { chosenIn.rank = key; }); draw(); } }, title, key === chosenIn.rank ? " ▾" : ""))))),
        el("tbody", {}, there.map(({ name: m }) => el("tr", { class: m === wanted ? "wanted" : false },
          el("th", { scope: "row" }, mark(m), el("a", { href: link({ scenario: name, method: m }) }, short(m, 26))),
          columns.map(([key, , , get, say]) => {
            const v = get(m), early = key.startsWith("time") && page.stopped[m]?.[name];
            return el("td", { class: v === best[key] && !["failed", "laws"].includes(key) ? "best" : false }, v === undefined ? "" : v === null ? (early ? "…" : "–") : say(v, m));
          })))))));
  };
  draw();
  return root;
};
const speedHere = (name, wanted, panels) => {
  const place = el("div", { class: "chart" }), root = el("div", {}), front = leaders(name);
  if (wanted) front.add(wanted);
  const draw = () => {
    root.replaceChildren(el("div", { class: "tools" }, choose(panels, chosenIn, draw), fixedOnly(chosenIn, draw),
      again(`tcbench run -s ${word(name)} --study work_precision -o mine`, `tcbench plot work-precision mine -s ${word(name)} -o speed.svg`)), place);
    drawn(place, (width) => place.replaceChildren(panelChart(ofFixed(chosenOf(panels, chosenIn), chosenIn.fixed), width, width < 500 ? 320 : 400, { shown: front, toggled: (m) => { front[front.has(m) ? "delete" : "add"](m); draw(); } })));
  };
  draw();
  return root;
};
// what a cell of the overview said, and the run behind it
const numberOf = (key, name, scenario) => {
  const lens = page.lenses.find((l) => l.key === key), v = lens?.cells[name]?.[scenario];
  if (v === undefined) return [];
  const kind = LENSES[key][1], all = Object.values(lens.cells).map((of) => of[scenario]).filter(known);
  return [`${LENSES[key][0][0].toUpperCase()}${LENSES[key][0].slice(1)}: ${cellTip(kind, v, all.length ? Math.min(...all) : null, kind === "time" && page.stopped[name]?.[scenario]).join("; ")}.`];
};
const runBehind = (key, name, scenario, work) => {
  const mine = work.filter((r) => r.integrator === name), fixed = mine.filter((r) => r.control === "dt");
  const target = key?.startsWith("time") ? +key.split(" ").at(-1) : null, column = key?.includes("energy") ? "energy_error_max" : "error";
  const rung = target ? mine.filter((r) => r.status === "ok" && r[column] <= target).sort((a, b) => a.wall_time_min_s - b.wall_time_min_s)[0]
    : ["coarse", "produced"].includes(key) ? fixed.sort((a, b) => b.value - a.value)[0] : null;
  const dt = scenes[scenario]?.dt, control = rung ? (rung.control === "dt" ? ` --dt ${+rung.value.toPrecision(6)}` : ` --tolerance ${rung.value}`) : fixed.length && dt ? ` --dt ${dt}` : "";
  return again(`tcbench simulate ${word(name)} ${word(scenario)}${control}`);
};

// every method at its steps and tolerances: from the study of speed or of tolerances, else from that of the laws
const rungsOf = async (scenario) => {
  const from = ["work_precision", "tolerance", "conservation"].find((t) => page.tables[t]), found = rows(await table(from), { scenario });
  return from !== "conservation" ? found : found.map((r) => ({ ...r, control: known(r.dt) ? "dt" : "rtol", value: r.dt ?? r.tolerance }));
};
const scenarios = async (place) => {
  recall(chosenIn, OF_SCENARIO, place);
  const root = $("scenario-page"), name = [place.scenario, page.opening, page.scenarios[0]].find((s) => page.scenarios.includes(s));
  if (!name) { root.replaceChildren(empty("This run has no scenario.")); return; }
  const order = (r) => `${method[r.name]?.family ?? 4}${r.name}`;
  const runs = (await runsOf(name)).sort((a, b) => (order(a) < order(b) ? -1 : 1)), names = runs.map((r) => r.name);
  const work = await rungsOf(name), speeds = await panelsOf("work-precision", name);
  if (chosenIn.of !== name) [chosenIn.of, chosenIn.methods] = [name, new Set(place.shown ? place.shown.split(" ") : pair(runs, place.method))];
  if (place.method) chosenIn.methods.add(place.method);
  const stage = el("div", {}), charts = el("div", {});
  const perform = (wanted) => {
    const [left, right] = pair(runs, wanted);
    const pick = (which, now) => select(right ? which : "method", names.map((n) => [n, n]), now, (n) => { chosenIn[which] = n; chosenIn[which === "left" ? "right" : "left"] = which === "left" ? right : left; perform(); });
    const both = [left, right].filter(Boolean).map((n) => runs.find((r) => r.name === n));
    const spans = [["opening", `the first ${both.find((r) => r.opening)?.opening.length - 1} steps`], ["whole", "the whole run, thinned"]];
    stage.replaceChildren(el("div", { class: "tools" }, pick("left", left), right ? pick("right", right) : "", again(`tcbench animate ${[left, right].filter(Boolean).map(word).join(" ")} ${word(name)} -o runs.gif`),
      both.some((r) => r.opening) ? select("show", spans, chosenIn.span, (v) => { chosenIn.span = v; perform(left); }) : ""),
    player(shownOf(both), scenes[name] || {}));
  };
  root.replaceChildren(
    el("nav", { class: "choose", "aria-label": "scenarios", hidden: page.scenarios.length < 2 }, page.scenarios.map((s) => el("a", { href: link({ scenario: s }), "aria-current": s === name ? "page" : false, title: scenes[s]?.shows || false }, short(s)))),
    el("h2", {}, short(name, 80)), answered(name), place.method ? await together(place.method, name, place.lens, work) : "",
    el("div", { class: speeds.length ? "two answering" : "answering" }, el("section", {}, el("h3", {}, "Every method on it"), ranking(name, place.method, work)),
      speeds.length ? el("section", {}, el("h3", {}, "Speed against accuracy"), speedHere(name, place.method, speeds)) : ""),
    el("div", { class: "two" }, el("section", {}, el("h3", {}, "What it is"), about(name)),
      el("section", {}, el("h3", {}, "What happens, at its own step"), runs.length ? stage : empty("This run keeps no time series of this scenario."))),
    runs.length ? el("section", {}, el("h3", {}, "In time"), chips("methods in the charts", names, chosenIn.methods, () => losses(name, runs, charts)), charts) : "",
    el("section", { id: "scenario-tables" }));
  if (runs.length) { perform(place.method); await losses(name, runs, charts); }
  await listings($("scenario-tables"), "Its tables", { scenario: name });
};

// which scenario a problem of one's own is like: by its own step over what is fastest at its start, and by the step that methods endure
const LIMIT = 2;  // times the rate: Verlet's step is stable up to it, and the midpoint rule's factor (1 - x/2)/(1 + x/2) of what decays is negative beyond
const middle = (values) => values.sort((a, b) => a - b)[values.length >> 1];
const traits = (s) => {
  const of = (key) => Object.entries(page.lenses.find((l) => l.key === key)?.cells || {}).filter(([, row]) => known(row[s])).map(([m, row]) => [row[s], m]);
  const [least, first] = of("step").sort((a, b) => a[0] - b[0])[0] || [], wrong = middle(of("coarse").map(([v]) => v)), own = scenes[s]?.dt;
  const [decays, turns] = (scenes[s]?.rates || []).map((rate) => rate * own);
  const more = Object.values(page.dots[s] || {})[0]?.map(([law]) => law).filter((law) => !["energy", "entropy"].includes(law)) || [];
  return { stiff: turns > LIMIT || (known(least) && !(least >= own)), hot: known(decays) ? decays > LIMIT : null, said: [
    known(decays) ? `its own step, ${number(own)}, holds ${number(decays, 2)} decay times of what decays fastest, and ${number(turns, 2)} radians of the fastest vibration` : "",
    known(least) ? `the first method to fail, ${first}, fails above h = ${number(least, 2)}` : "no method has a limit of its step",
    known(wrong) ? `at the coarsest step half of the methods are off by ${percent(wrong)} in the temperatures, or more` : "it has no temperatures to be wrong",
    more.length ? `${more.map(words).join(", ")} kept besides energy` : "nothing but energy is kept"] };
};
const KINDS = [["Fast vibrations limit the step", true], ["The motion itself is the fastest thing", false]];
const HEAT = [["and heat flows, or friction acts, within a step", true], ["and heat flows slowly, or not at all", false], ["and how fast heat flows is not told in this folder", null]];
const likeView = async () => {
  const all = page.scenarios.map((s) => ({ s, ...traits(s) })), branch = (text, inside, of) => !of.length ? null : el("details", { open: true }, el("summary", {}, el("strong", {}, text), ` (${of.length})`), inside);
  $("like-page").replaceChildren(...KINDS.map(([text, stiff]) => [text, all.filter((t) => t.stiff === stiff)]).map(([text, of]) => branch(text,
    HEAT.map(([more, hot]) => [more, of.filter((t) => t.hot === hot)]).map(([more, leaves]) => branch(more, leaves.map(({ s, said }) => el("section", { class: "pair" },
      el("h3", {}, "Like ", el("a", { href: link({ scenario: s }) }, s), scenes[s] ? ` (${words(scenes[s].system)}${scenes[s].shows ? `: ${scenes[s].shows}` : ""})` : ""),
      el("p", { class: "soft" }, `If: ${said.filter(Boolean).join("; ")}.`), answered(s))), leaves)), of)).filter(Boolean));
};
