// Which view is shown: `#method=NAME`, `#scenario=NAME`, `#scenario=NAME&method=NAME`, `#lens=KEY`, `#table=NAME`, `#failures` ...
const VIEWS = { overview, scenario: scenarios, method: methods, failures: failuresView, claims: claimsView, charts: chartsView, table: tablesView, measured: async () => {} };
const where = () => {
  const place = {};
  for (const part of location.hash.slice(1).split("&").filter(Boolean)) {
    const [key, ...rest] = part.split("=");
    try { place[key] = decodeURIComponent(rest.join("=")); } catch { place[key] = rest.join("="); }
  }
  return place;
};
let turn = 0;
// a run of the claims alone measured no method: what it has to say is there
const only = page.tables.claims && !page.lenses.length && page.methods.every((m) => !m.order && !m.step && !m.laws.some((l) => l.of));
if (only) document.querySelector("#tabs a").hidden = true;
const route = async () => {
  const place = where(), mine = (turn += 1);
  const asked = place.scenario !== undefined ? "scenario" : Object.keys(VIEWS).find((v) => place[v] !== undefined && (v !== "charts" || page.charts.length)) || "overview";
  const name = asked === "overview" && only ? "claims" : asked;
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
