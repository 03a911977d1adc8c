// Which view is shown, and what is chosen in it, is in the address: `#method=NAME`, `#scenario=NAME&method=NAME`, `#lens=KEY`, ...
const VIEWS = { overview, scenario: scenarios, method: methods, failures: failuresView, claims: claimsView, charts: chartsView, table: tablesView, like: likeView, measured: async () => {} };
const MEANT = { scenarios: "scenario", methods: "method", tables: "table", failure: "failures", claim: "claims", chart: "charts" };
// a word that leads nowhere is said, with what there is
const notice = (place) => {
  const keys = Object.keys(place), strange = keys.filter((k) => !(k in VIEWS) && !CHOICES.has(k));
  const lost = ["scenario", "method", "table", "charts"].filter((k) => place[k] && !{ scenario: page.scenarios, method: Object.keys(method), table: Object.keys(page.tables), charts: page.charts }[k].includes(place[k]));
  $("notice").hidden = !strange.length && !lost.length;
  $("notice").textContent = [...strange.map((k) => `This page has no view ${short(k)}: it has ${Object.keys(VIEWS).join(", ")}.`), ...lost.map((k) => `This run has no ${k} ${short(place[k])}.`)].join(" ");
};
let turn = 0;
// a run of the claims or of a study of one's own measured no method: what it has to say is there
const bare = !page.lenses.length && !Object.keys(page.failures).length && !["work-precision", "stable-step", "failure-share"].some((c) => page.charts.includes(c)) && page.methods.every((m) => !m.order && !m.step && !m.laws.some((l) => l.of));
const only = bare && (page.tables.claims ? "claims" : page.charts.length ? "charts" : "table");
if (only) document.querySelector("#tabs a").hidden = true;
const route = async () => {
  const place = address(), mine = (turn += 1);
  for (const [wrong, right] of Object.entries(MEANT)) if (place[wrong] !== undefined) { place[right] ??= place[wrong]; delete place[wrong]; }
  notice(place);
  const asked = place.scenario !== undefined ? "scenario" : Object.keys(VIEWS).find((v) => place[v] !== undefined && (v !== "charts" || page.charts.length)) || "overview";
  const name = asked === "overview" && only ? only : asked;
  hideTip();
  for (const view of document.querySelectorAll("main > .view")) view.hidden = view.id !== `view-${name}`;
  for (const tab of document.querySelectorAll("#tabs a")) {
    if (tab.dataset.view === name) tab.setAttribute("aria-current", "page"); else tab.removeAttribute("aria-current");
  }
  if (mine > 1) scrollTo(0, 0);
  await VIEWS[name](place);
  document.documentElement.dataset.ready = name;
};
// what is wider than its place fades at the edge behind which there is more
const fade = () => {
  for (const box of document.querySelectorAll(".scroll")) {
    const left = box.scrollLeft > 1, right = box.scrollWidth - box.clientWidth - box.scrollLeft > 1;
    box.dataset.more = [left && "left", right && "right"].filter(Boolean).join(" ");
  }
};
let due = 0;
const soon = () => { cancelAnimationFrame(due); due = requestAnimationFrame(fade); };
new MutationObserver(soon).observe(document.querySelector("main"), { childList: true, subtree: true, attributeFilter: ["hidden", "open"] });
addEventListener("resize", soon);
document.addEventListener("scroll", soon, { capture: true, passive: true });
addEventListener("hashchange", route);
addEventListener("keydown", (event) => { if (event.key === "Escape") hideTip(); });
addEventListener("scroll", hideTip, { passive: true });
document.documentElement.classList.remove("no-script");
route();
