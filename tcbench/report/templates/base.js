// Small things that every view needs: elements, numbers as text, the tables of the page, the tooltip.
const SVG = "http://www.w3.org/2000/svg";
const $ = (id) => document.getElementById(id);
// what the page holds is packed; a table is unpacked when a view first asks for it
const unpack = async (id) => {
  const text = atob($(id).textContent), packed = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i += 1) packed[i] = text.charCodeAt(i);
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
};
const page = JSON.parse(await unpack("page"));

const fill = (element, attributes, children) => {
  for (const [key, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key === "style") element.style.cssText = value;  // not as an attribute: the page's policy forbids those
    else element.setAttribute(key, value === true ? "" : value);
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  return element;
};
const el = (tag, attributes = {}, ...children) => fill(document.createElement(tag), attributes, children);
const shape = (tag, attributes = {}, ...children) => fill(document.createElementNS(SVG, tag), attributes, children);

const known = (value) => typeof value === "number" && Number.isFinite(value);
const SUPER = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };
const power = (n) => `10${[...String(n)].map((c) => SUPER[c]).join("")}`;
const number = (value, digits = 3) => {
  if (!known(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size >= 1e5 || size < 1e-3)) {
    return value.toExponential(digits - 1).replace(/\.?0+e/, "e").replace("e+", "e");
  }
  return String(+value.toPrecision(digits));
};
const seconds = (value) => {
  if (!known(value)) return "–";
  const [size, unit] = value >= 1 ? [1, "s"] : value >= 1e-3 ? [1e-3, "ms"] : [1e-6, "µs"];
  return `${number(value / size)} ${unit}`;
};
const words = (name) => String(name).replaceAll("_", " ");
const label = (column) => page.labels[column] || words(column);
const short = (text, length = 40) => (String(text).length > length ? `${String(text).slice(0, length - 1)}…` : String(text));
const download = (name, parts, type) => {
  const url = URL.createObjectURL(new Blob(parts, { type }));
  el("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
};
// text that begins as a formula does gets an apostrophe, as in the files of the run: no spreadsheet computes it
const inert = (v) => (typeof v === "string" && /^(?:[=+@\t\r]|-.)/.test(v) ? `'${v}` : String(v));
const quoted = (v) => (v === null || v === undefined ? "" : /[",\n\r]/.test(String(v)) ? `"${inert(v).replaceAll('"', '""')}"` : inert(v));
const asCSV = (names, lines) => `${[names, ...lines].map((line) => line.map(quoted).join(",")).join("\n")}\n`;
const prose = (text) => text.split(/`([^`]+)`/).map((part, i) => (i % 2 ? el("code", {}, part) : part));  // code between backticks
const broken = (name) => String(name).split(/(?<=_)/).flatMap((part) => [part, el("wbr")]);  // may break after "_"
const extent = (values) => values.reduce(([lo, hi], v) => [Math.min(lo, v), Math.max(hi, v)], [Infinity, -Infinity]);
const unique = (values) => [...new Set(values)];

// the address says what is chosen: a link leads to the same view with the same choices
const CHOICES = new Set(["limits", "shown", "lens", "on", "show", "fixed", "sort", "of", "step", "by", "left", "right", "loss", "span", "minus", "off", "only", "variable", "search", "filter", "verdict", "overview"]);
const address = () => {
  const place = {};
  for (const part of location.hash.slice(1).split("&").filter(Boolean)) {
    const [key, ...rest] = part.split("=");
    try { place[key] = decodeURIComponent(rest.join("=")); } catch { place[key] = rest.join("="); }
  }
  return place;
};
let acting = false;  // a choice of the reader, which the address keeps; a default it does not
const act = (change) => { acting = true; try { change(); } finally { acting = false; } };
// an object whose keys are choices; keys: key -> its name in the address
const choosing = (keys, values) => Object.assign(new Proxy(values, { set(target, key, value) {
  target[key] = value;
  if (acting && keys[key]) remember({ [keys[key]]: value });
  return true;
} }));
const recall = (chosen, keys, place) => { for (const [key, name] of Object.entries(keys)) if (place[name]) chosen[key] = place[name]; };
const remember = (choices) => {
  const place = { ...address(), ...choices };
  for (const key of Object.keys(place)) if (place[key] === null || place[key] === undefined || (place[key] === "" && CHOICES.has(key))) delete place[key];
  history.replaceState(null, "", `${location.pathname}${location.search}${link(place)}`);
};
const link = (place) => `#${Object.entries(place).map(([k, v]) => `${k}=${encodeURIComponent(v)}`).join("&")}`;
const method = Object.fromEntries(page.methods.map((m) => [m.name, m]));
const told = page.declared.integrators, scenes = page.declared.scenarios;
// one colour, marker and dash a method: those of the pictures of its run; lightened where the page is dark
const look = (name) => page.looks[name] || ["#59626d", "o", ""];
const colour = (name) => `color-mix(in srgb, ${look(name)[0]} var(--keep), var(--lift))`;
const MARKS = {
  o: "M-1,0a1,1 0 1,0 2,0a1,1 0 1,0 -2,0z", s: "M-.85,-.85h1.7v1.7h-1.7z", "^": "M0,-1L1,.8H-1z", v: "M0,1L1,-.8H-1z",
  "<": "M-1,0L.8,-1V1z", ">": "M1,0L-.8,-1V1z", D: "M0,-1.1L1.1,0L0,1.1L-1.1,0z", d: "M0,-1.2L.7,0L0,1.2L-.7,0z",
  P: "M-.4,-1h.8v.6h.6v.8h-.6v.6h-.8v-.6h-.6v-.8h.6z", X: "M-1,-.5L-.5,-1L0,-.5L.5,-1L1,-.5L.5,0L1,.5L.5,1L0,.5L-.5,1L-1,.5L-.5,0z",
  p: "M0,-1L.95,-.31L.59,.81H-.59L-.95,-.31z", h: "M0,-1L.87,-.5V.5L0,1L-.87,.5V-.5z",
  "*": "M0,-1.2L.3,-.4L1.14,-.37L.48,.15L.7,.97L0,.5L-.7,.97L-.48,.15L-1.14,-.37L-.3,-.4z",
};
const marker = (name, x, y, size) => shape("path", { class: "marker", d: MARKS[look(name)[1]] || MARKS.o, transform: `translate(${x.toFixed(1)},${y.toFixed(1)}) scale(${size})` });
const mark = (name) => shape("svg", { class: "mark", width: 13, height: 11, viewBox: "-6.5 -5.5 13 11", "aria-hidden": "true", style: `--own:${colour(name)}` }, marker(name, 0, 0, 4));
// how a chart is made again from the tables of this folder, or anew
const again = (...commands) => el("details", { class: "again" }, el("summary", {}, "reproduce this"), el("pre", {}, commands.join("\n")));
const inRun = /\[run=[^\]]*\]|,run=[^\]]*(?=\])/g;  // of which of several runs a method is: no command knows it
const word = (given) => { const text = String(given).replace(inRun, ""); return plainWord(text); };
const plainWord = (text) => (/^[\w.,:=+-]+$/.test(text) ? text : `'${String(text).replaceAll("'", "'\\''")}'`);
const marked = (counts) => Object.entries(page.marks).filter(([m]) => counts?.[m]).map(([m, text]) => el("span", { class: "end", title: text }, `${counts[m]} ${m} `));
const lawful = (m) => page.lawful.includes(m.name);  // they ended every run with every law kept

// a column that few rows have: from which row on, and the numbers there
const spread = ({ from, of }, size) => {
  const found = new Array(size).fill(null);
  from.forEach((start, k) => of[k].forEach((v, i) => { found[start + i] = v; }));
  return found;
};
const loaded = {};
const table = (name) => {
  if (!page.tables[name]) return Promise.resolve(null);
  loaded[name] ||= unpack(`table-${name}`).then((text) => {
    const found = { name, size: page.tables[name], columns: {} };
    for (const [column, values] of Object.entries(JSON.parse(text))) {
      found.columns[column] = Array.isArray(values) ? values : values.words ? values.at.map((i) => (i < 0 ? null : values.words[i])) : spread(values, found.size);
    }
    return found;
  });
  return loaded[name];
};
// the rows of a table that agree with `where`, as objects
const rows = (found, where = {}) => {
  if (!found) return [];
  const names = Object.keys(found.columns), wanted = Object.entries(where).filter(([c]) => found.columns[c]);
  const chosen = [];
  for (let i = 0; i < found.size; i += 1) {
    if (wanted.every(([c, v]) => found.columns[c][i] === v)) {
      chosen.push(Object.fromEntries(names.map((c) => [c, found.columns[c][i]])));
    }
  }
  return chosen;
};
const grouped = (list, key) => {
  const groups = new Map();
  for (const item of list) {
    if (!groups.has(item[key])) groups.set(item[key], []);
    groups.get(item[key]).push(item);
  }
  return groups;
};

const select = (title, values, chosen, changed) => {
  const box = el("select", { onchange: () => act(() => changed(box.value)) },
    values.map(([value, text]) => el("option", { value, selected: value === chosen }, short(text, 60))));
  return el("label", {}, `${title} `, box);
};
const chips = (title, names, chosen, toggled) => el("div", { class: "chips", role: "group", "aria-label": title },
  names.map((name) => el("button", {
    type: "button", "aria-pressed": String(chosen.has(name)), title: name, style: `--own:${colour(name)}`,
    onclick: (event) => {
      chosen[chosen.has(name) ? "delete" : "add"](name);
      event.currentTarget.setAttribute("aria-pressed", String(chosen.has(name)));
      remember({ shown: [...chosen].join(" ") });
      toggled();
    },
  }, mark(name), short(name))));

const tip = $("tip");
const showTip = (lines, x, y) => {
  tip.replaceChildren(...lines.map((line, i) => el(i ? "div" : "strong", {}, short(line, 400))));
  tip.hidden = false;
  const { width, height } = tip.getBoundingClientRect();
  tip.style.left = `${Math.max(4, Math.min(x + 14, innerWidth - width - 8))}px`;
  tip.style.top = `${y + 16 + height > innerHeight ? Math.max(4, y - height - 10) : y + 16}px`;
};
const hideTip = () => { tip.hidden = true; };
// an element whose tooltip answers to pointer and keyboard
const tipped = (element, lines) => fill(element, {
  onpointermove: (event) => showTip(lines(), event.clientX, event.clientY), onpointerleave: hideTip,
  onfocus: () => { const box = element.getBoundingClientRect(); showTip(lines(), box.left, box.bottom - 12); },
  onblur: hideTip,
}, []);

// what depends on the width of its place is drawn again when that changes
const watcher = new ResizeObserver((entries) => {
  for (const { target, contentRect } of entries) {
    const width = Math.floor(contentRect.width);
    if (width > 40 && target.drawnAt !== width && target.draw) { target.drawnAt = width; target.draw(width); }
  }
});
const drawn = (place, draw) => {
  place.draw = draw;
  const width = Math.floor(place.clientWidth);
  if (width > 40) { place.drawnAt = width; draw(width); }
  watcher.observe(place);
  return place;
};
