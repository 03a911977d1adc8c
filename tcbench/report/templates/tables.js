// Tables: sorted and searched by DataTables, which is unpacked when the first one is shown; saved as CSV.
let library = null;
const dataTables = () => {
  library ||= unpack("library").then((text) => { document.head.append(el("script", {}, text)); });
  return library;
};
const save = (found, chosen) => {
  const names = Object.keys(found.columns).filter((c) => chosen.some((r) => r[c] !== undefined));
  download(`${found.name}.csv`, [asCSV(names, chosen.map((r) => names.map((c) => r[c])))], "text/csv");
};
const inCell = (v, kind) => (kind !== "display" || v === null ? v : typeof v === "number" ? number(v, 4) : typeof v === "boolean" ? (v ? "yes" : "no") : v);

// one table with its search, its lists of values and its file
const listing = async (name, where = {}) => {
  const whole = !Object.keys(where).length, place = address();
  const found = await table(name);
  await dataTables();
  const chosen = rows(found, where);
  const names = Object.keys(found.columns).filter((c) => where[c] === undefined && chosen.some((r) => r[c] !== null && r[c] !== ""));
  const grid = el("table", { class: "data" }), box = el("input", { type: "search", "aria-label": `search ${name}` });
  const holder = el("div", { class: "listing" });
  const picked = {}, tools = el("div", { class: "tools" }, el("label", {}, "Search ", box));
  holder.append(tools, el("div", { class: "grid-of-rows scroll", tabindex: 0, role: "region", "aria-label": `table ${name}` }, grid));
  const render = (c) => (v, kind) => { const shown = inCell(v, kind); return kind === "display" && typeof shown === "string" ? document.createTextNode(short(shown, 2000)) : shown; };
  const live = new DataTable(grid, {
    data: chosen.map((r) => names.map((c) => r[c])), columns: names.map((c) => ({ title: c, type: numeric(chosen, c) ? "num" : "string", className: numeric(chosen, c) ? "number" : chosen.some((r) => String(r[c] ?? "").length > 45) ? "text" : "word", render: render(c), createdCell: (td, v) => { if (typeof v === "string" && v.length > 45) td.title = short(v, 2000); } })),
    order: [], paging: chosen.length > 100, pageLength: 100, lengthChange: false, deferRender: true, autoWidth: false, info: chosen.length > 100,
    layout: { topStart: null, topEnd: null, bottomStart: chosen.length > 100 ? "info" : null, bottomEnd: chosen.length > 100 ? "paging" : null },
  });
  grid.querySelectorAll("thead th").forEach((th, i) => { th.title = label(names[i]); });
  const asked = Object.fromEntries(((whole && place.filter) || "").split(";").filter(Boolean).map((part) => part.split("=")));
  const filter = (c, v) => {
    picked[c] = v;
    live.column(names.indexOf(c)).search((text, row) => !v || String(row[names.indexOf(c)]) === v).draw();
    if (acting && whole) remember({ table: name, filter: Object.entries(picked).filter(([, w]) => w).map((p) => p.join("=")).join(";") });
  };
  for (const c of names.filter((n) => (page.filters[name] || []).includes(n))) {
    const values = unique(chosen.map((r) => r[c]).filter((v) => v !== null)).map(String).sort();
    if (values.length > 1 && values.length <= 100) tools.append(select(words(c), [["", "all"], ...values.map((v) => [v, v])], asked[c] || "", (v) => filter(c, v)));
    if (values.includes(asked[c])) filter(c, asked[c]);
  }
  const sought = () => { live.search(box.value).draw(); };
  box.value = (whole && place.search) || "";
  box.addEventListener("input", () => { sought(); if (whole) remember({ table: name, search: box.value }); });
  const button = el("button", { type: "button", onclick: () => save(found, live.rows({ search: "applied" }).indexes().toArray().map((i) => chosen[i])) });
  const count = () => { button.textContent = `Save ${name}.csv (${live.rows({ search: "applied" }).count()} rows)`; };
  live.on("draw", count);
  sought();
  tools.append(button);
  return holder;
};
const numeric = (chosen, c) => chosen.every((r) => r[c] === null || typeof r[c] === "number");

// a list of the tables that have rows there, one of them open
const listings = async (place, title, where, start) => {
  const there = Object.keys(page.tables).filter((name) => !where.scenario || page.places[name].includes(where.scenario));
  if (!there.length) return;
  const holder = el("div", {});
  let open = there.includes(start) ? start : null;
  const show = async (name) => {
    open = name;
    buttons.querySelectorAll("button").forEach((b) => b.setAttribute("aria-pressed", String(b.dataset.name === name)));
    holder.replaceChildren(await listing(name, where));
  };
  const buttons = el("div", { class: "chips plain", role: "group", "aria-label": title }, there.map((name) => el("button", { type: "button", "data-name": name, "aria-pressed": "false", onclick: () => { if (!Object.keys(where).length) remember({ table: name, filter: null, search: null }); show(name); } },
    `${words(name)}`, Object.keys(where).length ? "" : el("small", {}, ` ${page.tables[name]}`))));
  place.replaceChildren(el("h3", {}, title), buttons, holder);
  if (open) await show(open);
};
const tablesView = async (place) => listings($("table-page"), "Every table of this run", {}, place.table || Object.keys(page.tables)[0]);

const failuresView = async () => {
  const root = $("failure-page"), ladders = Object.entries(page.failures).flatMap(([m, at]) => Object.entries(at).map(([s, [failed, runs, text, counts]]) => ({ m, s, failed, runs, text, counts })));
  if (!ladders.length) { root.replaceChildren(el("h2", {}, "Where methods fail"), empty(`Nowhere: ${page.tables.conservation || page.tables.work_precision ? "every run on the ladders of steps and tolerances reached its end" : "every measurement has a result"}.`)); return; }
  const total = ladders.reduce((n, f) => n + f.failed, 0), failing = ladders.filter((f) => f.failed).length, fell = ladders.filter((f) => f.counts?.S).length;
  root.replaceChildren(el("h2", {}, "Where methods fail"), el("p", {}, `${total} runs and measurements failed, in ${failing} pairs of method and scenario${fell ? `; in ${fell} the entropy fell` : ""}. A failure is a result. How runs end: ${Object.entries(page.marks).map((p) => p.join(" ")).join(", ")}. Where only the entropy fell, the run reached its end. V₀, the initial exergy, is the part of the energy that can still move or heat something. Each line shows the smallest step or tolerance that failed, and why.`),
    simple(["method", "scenario", "failed", "how", "what happened"], ladders.sort((a, b) => (method[a.m]?.family ?? 4) - (method[b.m]?.family ?? 4) || (a.m < b.m ? -1 : a.m > b.m ? 1 : b.failed - a.failed))
      .map((f) => [el("a", { href: link({ method: f.m }) }, mark(f.m), short(f.m)), el("a", { href: link({ scenario: f.s, method: f.m }) }, short(f.s)), `${f.failed} of ${f.runs}`, el("span", {}, marked(f.counts)), f.text])));
};

// names of methods and scenarios in a sentence lead to them
const linked = (text) => el("span", { class: text.length > 28 ? "text" : false }, text.split(/([\w[\]=.]+)/).map((part) => (method[part] ? el("a", { href: link({ method: part }) }, part) : page.scenarios.includes(part) ? el("a", { href: link({ scenario: part }) }, part) : part)));
const claimsView = async (place) => {
  const root = $("claim-page"), all = rows(await table("claims"));
  const rank = (r) => (r.verdict === "holds" ? 2 : r.verdict ? 0 : 1), verdict = (r) => r.verdict || "not measured", list = el("div", {});
  const sought = el("input", { type: "search", value: place.search || "", oninput: () => { remember({ claims: "", search: sought.value }); show(); } });
  const found = (r) => [r.claim, r.section].join(" ").toLowerCase().includes(sought.value.toLowerCase());
  let wanted = all.some((r) => verdict(r) === place.verdict) ? place.verdict : "";
  const show = () => list.replaceChildren(simple(["claim", "section", "expected", "measured", "verdict", "why"], all.filter((r) => found(r) && (!wanted || verdict(r) === wanted)).map((r, i) => [r, i]).sort(([a, i], [b, j]) => rank(a) - rank(b) || i - j)
    .map(([r]) => [linked(r.claim || ""), r.section || "", r.expected || "", linked(r.measured || ""), verdict(r), el("div", { class: "text" }, r.why || "", r.command ? again(r.command) : "")])));
  root.replaceChildren(el("h2", {}, "The paper's claims"), el("p", {}, page.paper), el("div", { class: "tools" },
    select("verdict", [["", `all ${all.length}`], ...[...grouped(all.map((r) => ({ v: verdict(r) })), "v")].map(([v, of]) => [v, `${v} (${of.length})`])], wanted, (v) => { wanted = v; remember({ claims: "", verdict: v }); show(); }), el("label", {}, "Search ", sought)), list);
  show();
  if (!page.tables.literature) return;
  for (const [who, list] of grouped(rows(await table("literature")), "stated_by"))
    root.append(el("h2", {}, who === "tcbench" ? "Beside it, measured by tcbench" : `Stated by ${who}`),
      simple(["claim", "expected", "measured", "verdict", "why"], list.map((r) => [r.claim || "", r.expected || "", r.measured || "", r.verdict || "not measured", r.why || ""])));
};
