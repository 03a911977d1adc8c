// The player: a system moving, two methods side by side, E, S and the invariants as running lines. Springs in the plane
// are drawn, coloured by temperature, and the lines that a system says itself (points); meshes, trusses and rods in
// space are filled by temperature, and turned by a slider; of others the variables run too.
const TRAIL = 60;  // states of a trace
const heat = (share) => {  // cold to hot, told apart with any kind of colour vision
  const stops = [[43, 91, 168], [126, 126, 132], [226, 116, 22]], at = Math.min(1.999, Math.max(0, 2 * share)), i = Math.floor(at);
  return `rgb(${stops[i].map((v, k) => Math.round(v + (at - i) * (stops[i + 1][k] - v))).join(",")})`;
};
const LETTERS = [..."abcdefghijklmnopqrstuvwxyz"];
const lettered = (one, prefix) => LETTERS.map((l) => `${prefix}_${l}`).filter((c) => one[0] && one[0][c] !== undefined && one.some((r) => known(r[c])));
// columns of places in the plane: of masses that springs join, or of the joints of a system's own picture
const placed = (facts) => (facts.joints?.length ? ["at_x_", "at_y_"] : ["x_", "y_"]);
const masses = (one, [x, y]) => Array.from({ length: 99 }, (_, i) => i + 1).filter((i) => one[0] && known(one[0][x + i]) && known(one[0][y + i]));

const variablesOf = (states) => page.variables.filter((c) => states[0]?.[c] !== undefined && states.some((r) => known(r[c])));
const MOST_LINES = 12;  // running lines of variables beside the laws

const index = (states, t) => {  // of the last state up to t
  let low = 0, high = states.length - 1;
  while (low < high) { const middle = (low + high + 1) >> 1; if (states[middle].t <= t) low = middle; else high = middle - 1; }
  return low;
};

// runs: [{name, states, record, failure}] of one scenario: states are drawn, the record has E, S, J at the same or fewer times
const player = (runs, facts) => {
  const state = { at: 0, on: false, speed: 1, last: 0 }, meshes = facts.faces?.length ? meshView(runs, facts.faces) : null;
  const times = unique(runs.flatMap((run) => run.states.map((r) => r.t))).sort((a, b) => a - b), end = times.at(-1) || 1;
  const temperatures = (meshes ? runs.flatMap((run) => run.frames.flatMap((f) => f.heat)) : runs.flatMap((run) => lettered(run.states, "temperature").flatMap((c) => run.states.map((r) => r[c])))).filter(known);
  const [cold, hot] = extent(temperatures);
  const reach = reached(runs, placed(facts));
  const sides = runs.map((run) => side(run, facts, [cold, hot], runs, reach, meshes));
  const time = el("output", {}), slider = el("input", { type: "range", min: 0, max: end, step: end / 600, value: 0, "aria-label": "time",
    oninput: () => { state.at = +slider.value; show(); } });
  const show = () => {
    slider.value = state.at;
    time.textContent = `t = ${state.at.toFixed(end > 100 ? 0 : 1)}`;
    sides.forEach((one, i) => one.show(index(runs[i].states, state.at), state.at));
  };
  const tick = (now) => {
    if (!state.on || !slider.isConnected) return;
    state.at = Math.min(end, state.at + (Math.min(100, now - state.last) / 1000) * (end / 20) * state.speed);
    state.last = now;
    if (state.at >= end) play(false);
    show();
    if (state.on) requestAnimationFrame(tick);
  };
  const button = el("button", { type: "button", onclick: () => play(!state.on) });
  const play = (on) => {
    if (on && state.at >= end) state.at = 0;
    state.on = on;
    state.last = performance.now();
    button.textContent = on ? "❚❚ Pause" : "▶ Play";
    if (on) requestAnimationFrame(tick);
  };
  play(false);
  const bar = el("div", { class: "tools" }, button, slider, time,
    select("speed", [["0.3", "slow"], ["1", "normal"], ["4", "fast"]], "1", (v) => { state.speed = +v; }),
    meshes?.deep ? el("label", {}, "turn ", el("input", { type: "range", min: 0, max: 360, value: TURN, oninput: (event) => { meshes.turn(+event.currentTarget.value); show(); } })) : "",
    hot > cold ? el("span", { class: "soft" }, el("span", { class: "heat" }), ` θ from ${number(cold)} to ${number(hot)}`) : "");
  const whole = el("div", { class: "player" }, el("div", { class: "sides" }, sides.map((one) => one.element)), bar);
  state.at = 0;
  requestAnimationFrame(show);
  return whole;
};

// how far any mass has been from the origin up to t: the picture grows with it, the same for both methods
const reached = (runs, [x, y]) => {
  const far = runs.map((run) => {
    let most = 0;
    return run.states.map((s) => {
      for (const i of masses(run.states, [x, y])) {
        const away = Math.hypot(s[x + i], s[y + i]);
        if (away < 1e6) most = Math.max(most, away);  // what flies away leaves the picture
      }
      return most;
    });
  });
  return (t) => Math.max(1e-9, ...runs.map((run, i) => far[i][index(run.states, t)]));
};

// a mesh in space, seen from above at an angle, or in the plane: its size is that of the runs that ended, or of the start
const TURN = 30, TILT = 0.45;
const meshView = (runs, faces) => {
  if (runs.some((run) => !run.frames.length)) return null;
  const good = runs.filter((run) => !run.failure), places = (good.length ? good.flatMap((run) => run.frames) : runs.map((run) => run.frames[0])).flatMap((f) => f.places);
  const [lows, highs] = [0, 1].map((end) => [0, 1, 2].map((k) => extent(places.map((p) => p[k]))[end])), centre = lows.map((low, k) => (low + highs[k]) / 2);
  const deep = highs[2] > lows[2], away = (p) => Math.hypot(...p.map((v, k) => v - centre[k])), reach = places.reduce((most, p) => Math.max(most, away(p)), 0) || 1;
  let [cos, sin] = [1, 0];
  const turn = (angle) => { [cos, sin] = [Math.cos((angle * Math.PI) / 180), Math.sin((angle * Math.PI) / 180)]; };
  if (deep) turn(TURN);
  // to the right, upwards, and towards the eye
  const seen = (p) => {
    const [x, y, z] = p.map((v, k) => v - centre[k]);
    if (!deep) return [x, y, 0];
    const behind = sin * x + cos * y;
    return [cos * x - sin * y, Math.cos(TILT) * z + Math.sin(TILT) * behind, Math.sin(TILT) * z - Math.cos(TILT) * behind];
  };
  const draw = (pen, { width, height }, frame, [cold, hot], ink) => {
    const scaled = deep ? (0.48 * height) / reach : 0.92 * Math.min(width / (highs[0] - lows[0] || 1), height / (highs[1] - lows[1] || 1));
    const at = frame.places.map(seen), middle = (face, k) => face.reduce((sum, i) => sum + at[i][k], 0) / face.length;
    pen.clearRect(0, 0, width, height);
    for (const [face, i] of faces.map((face, i) => [face, i, middle(face, 2)]).sort((a, b) => a[2] - b[2])) {
      const filled = known(frame.heat[i]) ? heat((frame.heat[i] - cold) / (hot - cold || 1)) : ink.getPropertyValue("--soft"), solid = face.length > 2;
      pen.beginPath();
      face.forEach((k, j) => pen[j ? "lineTo" : "moveTo"](width / 2 + scaled * at[k][0], height / 2 - scaled * at[k][1]));
      pen.lineWidth = solid ? 0.7 : highs[1] > lows[1] ? 5 : 40;
      pen.strokeStyle = solid ? ink.getPropertyValue("--text") : filled;
      if (solid) { pen.closePath(); pen.fillStyle = filled; pen.fill(); }
      pen.stroke();
    }
  };
  return { deep, turn, draw };
};

// one method: the drawing, and its running lines
const side = (run, facts, [cold, hot], runs, reach, meshes) => {
  const own = facts.joints?.length ? facts.joints : null, [px, py] = placed(facts), links = own || facts.links || [];
  const ids = masses(run.states, [px, py]), elements = lettered(run.states, "temperature");
  const canvas = meshes || (ids.length && links.length) ? el("canvas", { width: 640, height: 460, role: "img", "aria-label": `${run.name}: ${own || meshes ? "the system" : "the masses and springs"} at the time chosen below` }) : null;
  const said = el("p", { class: "soft said" });
  const dense = run.states.length > 2 && run.states[2].t - run.states[1].t <= 1.01 * run.dt;
  const draw = (k, t) => {
    const ink = getComputedStyle(document.documentElement), pen = canvas.getContext("2d"), { width, height } = canvas;
    if (meshes) { meshes.draw(pen, canvas, run.frames[index(run.frames, t)], [cold, hot], ink); return; }
    const size = (0.44 * height) / reach(t), at = (s, i) => (i ? [width / 2 + size * s[px + i], height / 2 - size * s[py + i]] : [width / 2, height / 2]);
    pen.clearRect(0, 0, width, height);
    pen.lineWidth = 1.5;
    if (dense) {  // every twentieth state is no path
      for (const i of ids) {
        pen.strokeStyle = ink.getPropertyValue("--soft");
        for (let j = Math.max(1, k - TRAIL); j <= k; j += 1) {
          pen.globalAlpha = 0.5 * (1 - (k - j) / TRAIL);
          pen.beginPath(); pen.moveTo(...at(run.states[j - 1], i)); pen.lineTo(...at(run.states[j], i)); pen.stroke();
        }
      }
      pen.globalAlpha = 1;
    }
    const now = run.states[k];
    links.forEach(([a, b], e) => {
      pen.strokeStyle = elements.length === links.length && known(now[elements[e]]) ? heat((now[elements[e]] - cold) / (hot - cold || 1)) : ink.getPropertyValue("--soft");
      pen.lineWidth = 4;
      (own ? rod : spring)(pen, at(now, a), at(now, b));
    });
    pen.fillStyle = ink.getPropertyValue("--text");
    for (const i of [0, ...ids]) {
      const [x, y] = at(now, i);
      if (!i && !links.flat().includes(0)) continue;
      pen.beginPath(); pen.arc(x, y, i ? 9 : 4, 0, 7); pen.fill();
    }
  };
  const all = meshes || (canvas && !own) ? [] : [...variablesOf(run.record), ...elements], told = all.slice(0, MOST_LINES);
  const wanted = ["energy", "entropy", ...(facts.invariants || ["angular_momentum"]), ...told];
  const kept = wanted.filter((c) => run.record.some((r) => known(r[c])));
  const places = kept.map((c) => strip(run, c, runs));
  const element = el("div", { class: "side", style: `--own:${colour(run.name)}` },
    el("h4", {}, el("a", { href: link({ method: run.name }) }, run.name)), canvas, said, places.map((p) => p.element),
    all.length > told.length ? el("p", { class: "soft" }, `The first ${told.length} of ${all.length} variables${elements.length ? " and temperatures" : ""}; the table series has all.`) : "");
  return { element, show: (k, t) => {
    if (canvas) draw(k, t);
    const over = run.whole && run.failure && t >= run.states.at(-1).t;
    said.textContent = over ? `Ended at t = ${number(run.states[k].t)}: ${run.failure}` : "";
    for (const p of places) p.show(t);
  } };
};
const rod = (pen, from, to) => { pen.beginPath(); pen.moveTo(...from); pen.lineTo(...to); pen.stroke(); };
const spring = (pen, [x0, y0], [x1, y1]) => {
  const turns = 11, dx = x1 - x0, dy = y1 - y0, length = Math.hypot(dx, dy) || 1, wide = Math.min(9, 900 / length);
  pen.beginPath(); pen.moveTo(x0, y0);
  for (let i = 1; i < turns; i += 1) {
    const share = i / turns, aside = (i % 2 ? 1 : -1) * wide;
    pen.lineTo(x0 + share * dx - (aside * dy) / length, y0 + share * dy + (aside * dx) / length);
  }
  pen.lineTo(x1, y1); pen.stroke();
};
// a small running line; both methods share the axis, so that a loss is seen
const strip = (run, column, runs) => {
  const name = { energy: "E", entropy: "S", angular_momentum: "J" }[column] || label(column), height = 44;
  let [low, high] = extent(runs.flatMap((r) => r.record.map((s) => s[column])).filter(known));
  const still = high - low < 1e-8 * Math.max(1, Math.abs(high));  // constant to round-off is flat, not magnified noise
  if (still) { const pad = 0.05 * Math.max(1, Math.abs(high)); low -= pad; high += pad; }
  const output = el("output", {}), place = el("div", { class: "strip" }), end = Math.max(...runs.map((r) => r.record.at(-1).t));
  let cursor = null, X = null, now = 0;
  const show = (t) => {
    now = t;
    output.textContent = number(run.record[index(run.record, t)][column], 6);
    if (!cursor) return;
    const x = X(Math.min(t, run.record.at(-1).t));
    cursor.setAttribute("x1", x);
    cursor.setAttribute("x2", x);
  };
  drawn(place, (width) => {
    X = scale("linear", [run.record[0].t, end], [2, width - 2]);
    const Y = scale("linear", padded("linear", [low, high]), [height - 4, 4]);
    cursor = shape("line", { class: "cursor", y1: 0, y2: height });
    const dots = run.record.length < 30 ? run.record.filter((s) => known(s[column])) : [];  // few: not every step is known
    place.replaceChildren(shape("svg", { width, height, "aria-hidden": true },
      shape("path", { class: "line", d: path(run.record.map((s) => ({ x: s.t, y: s[column] })), X, Y) }),
      dots.map((s) => shape("circle", { class: "dot", cx: X(s.t), cy: Y(s[column]), r: 2 })), cursor));
    show(now);
  });
  return { element: el("div", { class: "running" }, el("span", {}, `${name} = `, output), place), show };
};
