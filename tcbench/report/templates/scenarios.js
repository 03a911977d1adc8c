// Scenarios, one at a time: what it is, the player, losses in time, its tables; and one method on it.
const chosenIn = { methods: null, left: null, right: null, loss: "energy_error", span: "opening" };
const lost = (runs) => unique(runs.flatMap((r) => Object.keys(r.states[0]))).filter((c) => /_(error|fall|rise)$/.test(c));

const value = (v) => (Array.isArray(v) ? `(${v.map((x) => number(x, 6)).join(", ")})` : known(v) ? number(v, 6) : String(v));
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
  const opening = grouped(rows(await table("opening"), { scenario }), "integrator");
  return [...grouped(series, "integrator")].map(([name, states]) => {
    const { dt, tolerance } = states[0], first = opening.get(name) || [];
    const own = ladder.find((r) => r.integrator === name && (known(dt) && dt > 0 ? Math.abs(r.dt / dt - 1) < 1e-9 : r.tolerance === tolerance));
    return { name, states, dt: dt || Infinity, opening: first.length && first.at(-1).t < states.at(-1).t ? first : null,
      failure: own && own.status !== "ok" ? own.failure || own.status : "" };
  });
};
// what the player shows of a run: all of its thin series, or every one of its first steps
const shownOf = (run) => {
  if (chosenIn.span === "whole" || !run.opening) return { ...run, whole: true, record: run.states };
  const end = run.opening.at(-1).t;
  return { ...run, states: run.opening, record: run.states.filter((s) => s.t <= end * 1.0001) };
};

const losses = (name, runs, place) => {
  const there = lost(runs).filter((c) => runs.some((r) => r.states.some((s) => known(s[c]))));
  if (!there.length) return;
  if (!there.includes(chosenIn.loss)) [chosenIn.loss] = there;
  const panels = [["loss", chosenIn.loss, "zerolog"], ...lettered(runs[0].states, "temperature").map((c) => ["", c, "linear"]),
    ...lettered(runs[0].states, "strain").map((c) => ["", c, "linear"]),
    ...(scenes[name]?.links?.length ? [] : variablesOf(runs[0].states).slice(0, MOST_LINES)).map((c) => ["", c, "linear"])];
  const shown = new Set([...chosenIn.methods].filter((m) => runs.some((r) => r.name === m)));
  const all = [...shown].map((m) => runs.find((r) => r.name === m));
  place.replaceChildren(el("div", { class: "tools" }, select("Loss of", there.map((c) => [c, label(c)]), chosenIn.loss, (c) => { chosenIn.loss = c; losses(name, runs, place); })),
    el("div", { class: "panels" }, panels.map(([what, column, kind]) => {
      const holder = el("figure", {}, el("figcaption", {}, label(column))), chart = el("div", {});
      holder.append(chart);
      setTimeout(() => drawn(chart, (width) => chart.replaceChildren(timeChart(all, column, kind, width))));
      return holder;
    })));
};
const timeChart = (runs, column, kind, width) => {
  const series = runs.map((run) => {
    let most = 0;  // the largest loss so far: a line that can be read
    const points = run.states.map((s) => {
      const y = kind === "zerolog" ? (most = Math.max(most, Math.abs(s[column] ?? 0))) : s[column];
      return { x: s.t, y, tell: () => [`t = ${number(s.t)}: ${number(s[column], 6)}`] };
    });
    const last = run.states.at(-1);
    return { name: run.name, fore: true, points, crosses: run.failure ? [{ x: last.t, tell: () => [`ended at t = ${number(last.t)}: ${run.failure}`] }] : [] };
  });
  const ys = series.flatMap((s) => s.points.map((p) => p.y)).filter(known);
  if (!ys.length) return empty("Choose a method above.");
  const positive = ys.filter((y) => y > 0);
  const domain = kind === "zerolog" ? [Math.max(1e-17, Math.min(...positive, 1e-15)), Math.max(...positive, 1e-14) * 2] : padded("linear", extent(ys));
  return lines(width, 250, { series, x: { kind: "linear", domain: extent(series.flatMap((s) => s.points.map((p) => p.x))), label: "time t" },
    y: { kind, domain, label: "" }, beside: width > 340, margin: { right: width > 340 ? 24 + 6.4 * Math.max(...series.map((s) => short(s.name, 24).length)) : 14, left: 56 }, title: `${label(column)} in time` });
};

// one method on one scenario: every run on its ladders, its order, its step
const together = async (name, scenario) => {
  const where = { integrator: name, scenario };
  const [ladder, work, steps, fits] = [rows(await table("conservation"), where), rows(await table("work_precision"), where), rows(await table("stability"), where), rows(await table("convergence"), where)];
  const bad = [...ladder.map((r) => ({ ...r, at: known(r.dt) ? `h = ${number(r.dt)}` : `tolerance ${number(r.tolerance)}` })), ...work.map((r) => ({ ...r, at: `${r.control === "dt" ? "h" : "rtol"} = ${number(r.value)}` }))].filter((r) => r.status && r.status !== "ok");
  const whole = fits.find((r) => r.variable === "all") || fits[0], step = steps[0];
  const parts = [];
  if (whole) parts.push(`Order ${orderWith(whole)}.`);
  if (step?.limit) parts.push(step.limit === "none" ? `No limit of its step found up to h = ${number(step.dt_cap)}.` : `Stable up to h = ${number(step.dt_stable)}; then ${step.limit}: ${LIMITS[step.limit] || ""}${step.cause ? ` (${words(step.cause)})` : ""}.`);
  const runs = ladder.length + work.length;
  parts.push(!runs ? "" : bad.length ? `${bad.length} of its ${runs} runs on the ladders of steps and tolerances failed:` : `All of its ${runs} runs on the ladders of steps and tolerances reached their end.`);
  const once = unique(bad.map((r) => `${r.at}: ${r.failure || r.status}`));
  return el("section", { class: "pair", style: `--own:${colour(name)}`, "aria-label": `${name} on ${scenario}` },
    el("h3", {}, el("a", { href: link({ method: name }) }, name), ` on ${scenario}`), parts.filter(Boolean).map((p) => el("p", {}, p)),
    once.length ? el("ul", {}, once.slice(0, 12).map((t) => el("li", {}, short(t, 500)))) : "", once.length > 12 ? el("p", { class: "soft" }, `and ${once.length - 12} more in the table below`) : "");
};
const LIMITS = { physical: "the solution is there, but energy, temperature or entropy leaves its bounds", branch: "the step's solution ends", solver: "a solution exists and Newton does not find it" };
const orderWith = (fit) => (known(fit.order) ? `${fit.order.toFixed(2)} (${fit.order_low.toFixed(3)} to ${fit.order_high.toFixed(3)}), declared ${fit.declared ?? "none"}` : `undetermined${fit.note ? `: ${fit.note}` : ""}`);

const scenarios = async (place) => {
  const root = $("scenario-page"), name = page.scenarios.includes(place.scenario) ? place.scenario : page.scenarios.find((s) => s === "stiff_spring") || page.scenarios[0];
  if (!name) { root.replaceChildren(empty("This run has no scenario.")); return; }
  const order = (r) => `${method[r.name]?.family ?? 4}${r.name}`;
  const runs = (await runsOf(name)).sort((a, b) => (order(a) < order(b) ? -1 : 1)), names = runs.map((r) => r.name);
  chosenIn.methods ||= new Set(PAPER.length ? PAPER : names.slice(0, 5));
  if (place.method) chosenIn.methods.add(place.method);
  if (!names.some((n) => chosenIn.methods.has(n))) names.slice(0, 5).forEach((n) => chosenIn.methods.add(n));
  const stage = el("div", {}), charts = el("div", {});
  const perform = (wanted) => {
    const [left, right] = pair(runs, wanted);
    const pick = (which, now) => select(right ? which : "method", names.map((n) => [n, n]), now, (n) => { chosenIn[which] = n; chosenIn[which === "left" ? "right" : "left"] = which === "left" ? right : left; perform(); });
    const both = [left, right].filter(Boolean).map((n) => runs.find((r) => r.name === n));
    const spans = [["opening", `the first ${both[0].opening?.length - 1} steps`], ["whole", "the whole run, thinned"]];
    stage.replaceChildren(el("div", { class: "tools" }, pick("left", left), right ? pick("right", right) : "",
      both.some((r) => r.opening) ? select("show", spans, chosenIn.span, (v) => { chosenIn.span = v; perform(left); }) : ""),
    player(both.map(shownOf), scenes[name] || {}));
  };
  root.replaceChildren(
    el("nav", { class: "choose", "aria-label": "scenarios", hidden: page.scenarios.length < 2 }, page.scenarios.map((s) => el("a", { href: link({ scenario: s }), "aria-current": s === name ? "page" : false }, short(s)))),
    el("h2", {}, short(name, 80)), place.method ? await together(place.method, name) : "",
    el("div", { class: "two" }, el("section", {}, el("h3", {}, "What it is"), about(name)),
      el("section", {}, el("h3", {}, "What happens, at its own step"), runs.length ? stage : empty("This run keeps no time series of this scenario."))),
    runs.length ? el("section", {}, el("h3", {}, "In time"), chips("methods in the charts", names, chosenIn.methods, () => losses(name, runs, charts)), charts) : "",
    el("section", { id: "scenario-tables" }));
  if (runs.length) { perform(place.method); losses(name, runs, charts); }
  await listings($("scenario-tables"), "Its tables", { scenario: name });
};
