// Charts as SVG: scales, axes, lines with their names at them, crosses for failed runs; the rest in grey answers.
const nice = (span, count) => {
  const raw = span / count, unit = 10 ** Math.floor(Math.log10(raw)), share = raw / unit;
  return unit * (share > 5 ? 10 : share > 2 ? 5 : share > 1 ? 2 : 1);
};
// kind: linear, log, or zerolog, a log axis that ends in a place for 0
const scale = (kind, [low, high], [from, to]) => {
  if (kind === "linear") {
    if (!(high > low)) { const pad = Math.abs(low) * 0.01 || 1; [low, high] = [low - pad, high + pad]; }
    const at = (v) => from + ((v - low) / (high - low)) * (to - from);
    return Object.assign(at, { kind, ticks: (count) => {
      const step = nice(high - low, count), found = [];
      for (let v = Math.ceil(low / step - 1e-9) * step; v <= high + step * 1e-9; v += step) found.push([v, number(+v.toPrecision(12), 6)]);
      return found;
    } });
  }
  const zero = kind === "zerolog", start = zero ? from + 0.07 * (to - from) : from;
  const floor = zero ? ROUND_OFF : low;
  const [a, b] = [Math.log10(floor), Math.max(Math.log10(high), Math.log10(floor) + (zero ? 3 : 0.5))];
  const at = (v) => (zero && v < floor ? from : start + ((Math.log10(v) - a) / (b - a)) * (to - start));
  return Object.assign(at, { kind, ticks: (count) => {
    const every = Math.max(1, Math.ceil((b - a) / count)), found = zero ? [[0, "0"]] : [];
    for (let n = Math.ceil(a - 1e-9); n <= b + 1e-9; n += 1) if (n % every === 0) found.push([10 ** n, power(n)]);
    if (found.length < 2) for (const m of [1, 2, 5, 10, 20, 50]) {
      const v = m * 10 ** Math.floor(a);
      if (v >= 10 ** a * 0.999 && v <= 10 ** b * 1.001 && !found.some(([w]) => w === v)) found.push([v, number(v)]);
    }
    return found;
  } });
};
// relative errors below it are round-off, over any number of steps: one place on an axis, in a grey band
const ROUND_OFF = 1e-12;
const padded = (kind, [low, high]) => (kind === "linear" ? [low - 0.04 * (high - low), high + 0.04 * (high - low)] : [low / 1.4, high * 1.4]);

// axes and grid; x, y: {kind, domain, label}
const frame = (width, height, { x, y, title, margin = {} }) => {
  const { left = 52, right = 12, top = 20, bottom = 36 } = margin;
  const X = scale(x.kind, x.domain, [left, width - right]);
  const Y = y.kind === "none" ? null : scale(y.kind, y.domain, [height - bottom, top]);
  const svg = shape("svg", { width, height, viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": title });
  for (const [v, text] of X.ticks(Math.max(2, Math.floor(width / 90)))) {
    svg.append(shape("line", { class: "grid", x1: X(v), x2: X(v), y1: top, y2: height - bottom }),
      shape("text", { x: X(v), y: height - bottom + 14, "text-anchor": "middle" }, x.text ? x.text(v) : text));
  }
  const foot = Y && y.errors && (y.kind === "zerolog" || y.domain[0] < ROUND_OFF) ? Y(ROUND_OFF) : null;
  if (foot !== null) svg.append(shape("rect", { class: "round-off", x: left, width: Math.max(0, width - right - left), y: foot, height: Math.max(0, height - bottom - foot) }));
  for (const [v, text] of Y ? Y.ticks(Math.max(2, Math.floor(height / 42))) : []) {
    svg.append(shape("line", { class: "grid", x1: left, x2: width - right, y1: Y(v), y2: Y(v) }),
      shape("text", { x: left - 6, y: Y(v) + 4, "text-anchor": "end" }, y.told ? y.told(v) : text));
  }
  svg.append(shape("text", { class: "axis", x: Math.max(0, left - 40), y: 11 }, y.label || ""),
    shape("text", { class: "axis", x: width - right, y: height - 4, "text-anchor": "end" }, x.label));
  return { svg, X, Y, left, right: width - right, top, bottom: height - bottom, width, height };
};

const path = (points, X, Y) => {
  let text = "", pen = false;
  for (const p of points) {
    if (known(p.x) && known(p.y)) text += `${pen ? "L" : "M"}${X(p.x).toFixed(1)},${Y(p.y).toFixed(1)}`;
    pen = known(p.x) && known(p.y);
  }
  return text;
};
// level up to the next point
const corners = (points) => points.flatMap((p, i) => (i ? [{ x: p.x, y: points[i - 1].y, low: points[i - 1].low, high: points[i - 1].high }, p] : [p]));
const cross = (x, y, size = 3.5) => `M${x - size},${y - size}l${2 * size},${2 * size}m0,${-2 * size}l${-2 * size},${2 * size}`;

// names at the ends of lines, or in the margin beside them, moved apart where they would cover each other
const placeNames = (f, names, beside) => {
  const boxes = names.map(({ text, x, y, ...rest }) => {
    const width = 6.4 * text.length + 8, over = x + width > f.width, left = beside ? f.right + 8 : x + 6;
    return { ...rest, text, x: over && !beside ? Math.max(2, f.width - width - 2) : left, y: over && !beside ? y - 8 : y + 4, x0: x, y0: y, width };
  }).sort((a, b) => a.y - b.y);
  const top = f.top + 8, bottom = f.bottom - 2;
  const spread = (share) => boxes.forEach((a, i) => boxes.slice(i + 1).forEach((b) => {
    const gap = 12.5 - (b.y - a.y);
    if (a.x + a.width < b.x || b.x + b.width < a.x || gap <= 0) return;
    a.y -= gap * share; b.y += gap * (1 - share);
  }));
  for (let round = 0; round < 200; round += 1) {
    spread(0.5);
    for (const box of boxes) box.y = Math.min(Math.max(box.y, top), bottom);
  }
  spread(0); // halves come close where names are held by an edge: those below make room
  for (const box of boxes) {
    if (beside || Math.hypot(box.x - box.x0, box.y - 4 - box.y0) > 16) {
      f.svg.append(shape("line", { class: "lead", x1: box.x0, y1: box.y0, x2: box.x, y2: box.y - 4 }));
    }
    f.svg.append(shape("text", { class: "name", x: box.x, y: box.y, style: `fill:color-mix(in srgb, ${box.colour} 72%, var(--text))` }, box.text));
  }
};

// series: {name, label, points: [{x, y, low, high, tell}], crosses: [{x, y, tell}], fore, dots}; label: at its end; low and high: a band;
// crosses without y stand at the top; toggled(name) when one is chosen; beside: the names stand in the right margin
const lines = (width, height, { series, toggled, beside, ...axes }) => {
  const f = frame(width, height, axes), { svg, X, Y } = f;
  const targets = [], drawnOf = new Map(), failing = unique(series.filter((s) => s.fore && s.crosses?.length).map((s) => s.name));
  for (const one of [...series].sort((a, b) => !!a.fore - !!b.fore)) {
    const group = drawnOf.get(one.name) || shape("g", { class: one.fore ? "fore" : "rest", style: `--own:${one.colour || colour(one.name)}` });
    const place = (p) => ({ ...p, name: one.name, px: X(p.x), py: Y(p.y) });
    const banded = one.fore ? (one.stepped ? corners(one.points) : one.points).filter((p) => known(p.low) && known(p.high)) : [];
    if (one.dots) for (const p of banded) group.append(shape("line", { class: "range", x1: X(p.x), x2: X(p.x), y1: Y(p.low), y2: Y(p.high) }));
    else if (banded.length > 1) {
      const back = [...banded].reverse().map((p) => ({ x: p.x, y: p.low }));
      group.append(shape("path", { class: "band", d: `${path([...banded.map((p) => ({ x: p.x, y: p.high })), ...back], X, Y)}Z` }));
    }
    if (!one.dots) group.append(shape("path", { class: "line", d: path(one.stepped ? corners(one.points) : one.points, X, Y), "stroke-dasharray": (one.fore && !one.colour && look(one.name)[2]) || false }));
    if (one.fore && !one.colour && !one.dots) {
      const there = one.points.filter((p) => known(p.x) && known(p.y)), every = Math.max(1, Math.ceil(there.length / 9));
      for (let i = there.length > 12 ? every >> 1 : 0; i < there.length; i += every) group.append(marker(one.name, X(there[i].x), Y(there[i].y), 3.4));
    }
    for (const p of one.points) {
      if (!known(p.x) || !known(p.y)) continue;
      targets.push(place(p));
      if (one.dots) group.append(shape("circle", { class: p.hollow ? "dot hollow" : "dot", cx: X(p.x), cy: Y(p.y), r: 3 }));
    }
    for (const p of one.crosses || []) {
      const px = X(p.x), py = known(p.y) ? Y(p.y) : f.top + 5 + Math.max(0, failing.indexOf(one.name)) * Math.min(6, 20 / failing.length);
      targets.push({ ...p, name: one.name, px, py });
      group.append(shape("path", { class: "cross", d: cross(px, py) }));
    }
    drawnOf.set(one.name, group);
    svg.append(group);
  }
  placeNames(f, series.filter((s) => s.fore && s.label).flatMap((s) => {
    const last = s.points.findLast((p) => known(p.x) && known(p.y));
    return last ? [{ text: short(s.label, 24), x: X(last.x), y: Y(last.y), colour: s.colour || colour(s.name) }] : [];
  }), beside);
  answer(svg, targets, drawnOf, toggled);
  return svg;
};

// the nearest line answers to the pointer, and to arrow keys; a click or Enter brings it to the front
const answer = (svg, targets, drawnOf, toggled) => {
  let hot = null;
  const names = [...drawnOf.keys()];
  const heat = (name) => {
    if (hot) drawnOf.get(hot).classList.remove("hot");
    hot = name;
    if (hot) drawnOf.get(hot).classList.add("hot");
  };
  const nearest = (event) => {
    const box = svg.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
    let best = null, least = 26;
    for (const t of targets) {
      const away = Math.hypot(t.px - x, t.py - y);
      if (away < least) [best, least] = [t, away];
    }
    return best;
  };
  const tell = (t, x, y) => { heat(t.name); showTip([t.name, ...(t.tell ? t.tell() : [])], x, y); };
  fill(svg, {
    tabindex: 0, "aria-description": "Arrow keys go from line to line.",
    onpointermove: (event) => { const t = nearest(event); if (t) tell(t, event.clientX, event.clientY); else { heat(null); hideTip(); } },
    onpointerleave: () => { heat(null); hideTip(); },
    onblur: () => { heat(null); hideTip(); },
    onclick: (event) => { const t = nearest(event); if (t && toggled) toggled(t.name); },
    onkeydown: (event) => {
      const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      if (event.key === "Enter" && hot && toggled) toggled(hot);
      if (!step || !names.length) return;
      event.preventDefault();
      const name = names[(names.indexOf(hot) + step + names.length) % names.length];
      const t = targets.findLast((p) => p.name === name), box = svg.getBoundingClientRect();
      if (t) tell(t, box.left + t.px, box.top + t.py); else heat(name);
    },
  }, []);
};

const empty = (text) => el("p", { class: "soft" }, text);
