// Methods, one at a time: what it is, claims against measurements, order, stable steps, speed and accuracy, failures.
const OF_METHOD = { scenario: "on", variable: "variable", speed: "of" };
const inMethod = choosing(OF_METHOD, { scenario: null, variable: null, speed: null });

const measured = (m) => {
  const lines = m.laws.filter((l) => l.of).map((law) => [words(law.law), law.claimed === null ? "?" : law.claimed ? "yes" : "no", `${law.kept} of ${law.of}`, number(law.worst), law.where,
    law.kept === law.of ? (law.claimed ? "kept" : "kept, not claimed") : law.claimed ? "BROKEN" : "not claimed, not kept"]);
  const absent = m.laws.filter((l) => !l.of).map((l) => words(l.law));
  return [simple(["law", "claimed", "kept in runs", "worst", "where", "verdict"], lines),
    empty(`Energy and invariants: the largest error over V₀ and over the initial value, kept up to 1e-9. Entropy: steps on which it fell.${absent.length ? ` Not measured: ${absent.join(", ")}.` : ""}`)];
};
// a plain table; texts wrap, numbers and names do not
const simple = (head, lines) => {
  const inside = (c, i) => {
    const kind = [c === "BROKEN" && "bad", typeof c === "string" && c.length > 28 && "text"].filter(Boolean).join(" ");
    return el(i ? "td" : "th", { class: kind || false, scope: i ? false : "row" }, c instanceof Node ? c : short(c, 600));
  };
  return el("div", { class: "scroll", tabindex: 0 }, el("table", { class: "simple" },
    el("thead", {}, el("tr", {}, head.map((h) => el("th", { scope: "col" }, h)))),
    el("tbody", {}, lines.map((line) => el("tr", {}, line.map(inside))))));
};

const here = (m, scenario) => el("a", { href: link({ scenario, method: m.name }) }, short(scenario));  // the method on it

const orders = async (m) => {
  const fits = rows(await table("convergence"), { integrator: m.name });
  if (!fits.length) return null;
  const where = unique(fits.map((r) => r.scenario)), place = el("div", {}), root = el("div", {});
  if (!where.includes(inMethod.scenario)) inMethod.scenario = where.find((s) => s === "short_term") || where[0];
  const draw = async () => {
    const panels = await panelsOf("convergence", inMethod.scenario), panel = [inMethod.variable, "the whole state"].map((t) => panels.find((p) => p.title === t)).find(Boolean) || panels[0];
    const line = panel.series.find((s) => s.at.length) || { found: { columns: {} }, at: [] }, variable = line.found.columns.variable?.[line.at[0]];
    const of = (s) => fits.find((r) => r.scenario === s && r.variable === variable), fit = of(inMethod.scenario);
    const lines_ = where.map(of).filter(Boolean)
      .map((r) => [here(m, r.scenario), known(r.order) ? r.order.toFixed(3) : "–", known(r.order_low) ? `${r.order_low.toFixed(3)} to ${r.order_high.toFixed(3)}` : "–", r.points_used ?? "–",
        known(r.dt_min) ? `${number(r.dt_min)} to ${number(r.dt_max)}` : "–", r.verdict || ""]);
    root.replaceChildren(el("div", { class: "tools" },
      select("scenario", where.map((s) => [s, s]), inMethod.scenario, (s) => { inMethod.scenario = s; draw(); }),
      select("variable", panels.map((p) => [p.title, p.title]), panel.title, (v) => { inMethod.variable = v; draw(); })),
    el("div", { class: "two" }, el("figure", {}, el("figcaption", {}, fit ? `${inMethod.scenario}: order ${orderWith(fit)}; filled: in the fit` : ""), place),
      simple(["scenario", "order", "interval", "points", "steps h", "verdict"], lines_)));
    const mine = onlyOf(panel, new Set([m.name]));
    drawn(place, (width) => place.replaceChildren(panelChart(mine, width, 280, { shown: new Set([m.name]), title: "Error against step size" })));
  };
  await draw();
  return root;
};

const stable = async (m) => {
  const all = rows(await table("stability"), { integrator: m.name });
  if (!all.length) return null;
  const lines_ = all.map((r) => [here(m, r.scenario),
    r.limit === "none" ? `no limit up to ${number(r.dt_cap)}` : r.limit ? number(r.dt_stable) : "no answer", r.limit && r.limit !== "none" ? `${r.limit}: ${LIMITS[r.limit] || ""}` : r.failure || "",
    r.limit_plain === "none" ? `no limit up to ${number(r.dt_cap)}` : number(r.dt_stable_plain)]);
  return [simple(["scenario", "largest stable h", "what ends it", "with plain Newton"], lines_)];
};

const speedOf = async (m) => {
  const mine = rows(await table("work_precision"), { integrator: m.name });
  if (!mine.length) return null;
  const where = unique(mine.map((r) => r.scenario)), place = el("div", {}), root = el("div", {});
  if (!where.includes(inMethod.speed)) inMethod.speed = where.includes(page.opening) ? page.opening : where[0];
  const reached = rows(await table("time_to_accuracy"), { integrator: m.name, measure: "error" });
  const lines_ = where.map((s) => [here(m, s), ...[1e-3, 1e-6, 1e-9].map((target) => {
    const row = reached.find((r) => r.scenario === s && r.target === target);
    return row ? (known(row.time_s) ? seconds(row.time_s) : "not reached") : "–";
  })]);
  const draw = async () => {
    const panels = await panelsOf("work-precision", inMethod.speed), scenario = inMethod.speed;
    root.replaceChildren(el("div", { class: "tools" }, select("scenario", where.map((s) => [s, s]), scenario, (s) => { inMethod.speed = s; draw(); })),
      el("div", { class: "two" }, place, simple(["scenario", "to 10⁻³", "to 10⁻⁶", "to 10⁻⁹"], lines_)));
    drawn(place, (width) => place.replaceChildren(panelChart(panels[0], width, 300, { shown: leaders(scenario).add(m.name), toggled: (name) => { location.hash = link({ method: name }); } })));
  };
  await draw();
  return root;
};

const ended = async (m) => {
  const found = [];
  for (const [study, step] of [["conservation", "dt"], ["work_precision", "value"], ["convergence_points", "dt"]]) {
    for (const r of rows(await table(study), { integrator: m.name })) {
      if (r.status && r.status !== "ok" && (study !== "convergence_points" || r.variable === "all")) found.push([here(m, r.scenario), words(study.replace("_points", "")), known(r[step]) ? number(r[step]) : known(r.tolerance) ? `tol ${number(r.tolerance)}` : "–", r.status, r.failure || r.reason || ""]);
    }
  }
  return found.length ? simple(["scenario", "study", "step or tolerance", "status", "what happened"], found.slice(0, 200)) : empty("Every run of this method reached its end.");
};

// what a formula is: it was run, and where no step of it took an iteration, there was nothing to solve
const solved = async (m) => {
  const counts = [...rows(await table("conservation"), { integrator: m.name }).map((r) => r.newton_iterations_mean),
    ...rows(await table("work_precision"), { integrator: m.name }).map((r) => r.newton_iterations)].filter(known);
  return !counts.length ? "a formula, compiled" : counts.every((n) => n === 0) ? "explicit, compiled" : "implicit, tcbench's Newton";
};

const methods = async (place) => {
  recall(inMethod, OF_METHOD, place);
  const root = $("method-page"), m = method[place.method] || page.methods[0];
  if (!m) { root.replaceChildren(empty("This run has no method.")); return; }
  const it = told[m.name], part = (title, content) => content && el("section", {}, el("h3", {}, title), content);
  root.replaceChildren(
    el("div", { class: "choose" }, select("Method", page.methods.map((x) => [x.name, x.name]), m.name, (name) => { location.hash = link({ method: name }); })),
    el("h2", { class: "own", style: `--own:${colour(m.name)}` }, mark(m.name), short(m.name, 80)),
    el("p", { class: "soft" }, [!it?.source?.startsWith(page.families[m.family]) && page.families[m.family], it?.source && short(it.source, 200), it && { flows: await solved(m), step: "a step of its own", adaptive: "chooses its steps" }[it.kind], it?.order && `declared order ${it.order}`].filter(Boolean).join(" · ")),
    el("div", { class: "two" }, el("section", {}, it ? [el("p", { class: "told" }, prose(it.description.replace(/([^\n])\n(?!\n)/g, "$1 "))), it.formula ? el("details", { open: true }, el("summary", {}, "Its formula, as its author wrote it"), el("pre", { tabindex: 0 }, it.formula)) : ""] : empty("This folder does not say what the method is: run its command again with this version of tcbench.")),
      part("Claimed and measured", m.laws.length ? measured(m) : empty("This run measured no laws.")) || ""));
  for (const content of [part("Order", await orders(m)), part("Speed and accuracy", await speedOf(m)), part("Largest stable steps", await stable(m)), part("Runs that failed", await ended(m))]) if (content) root.append(content);
};
