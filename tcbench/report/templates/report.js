"use strict";
(() => {
  const root = document.documentElement;
  root.classList.remove("no-script");
  const looks = JSON.parse(document.getElementById("looks").textContent);
  const css = (name) => getComputedStyle(root).getPropertyValue(name).trim();
  const make = (tag, text, attributes = {}) => {
    const element = document.createElement(tag);
    if (text !== undefined) element.textContent = text;
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return element;
  };
  const select = (title, values, chosen, changed) => {
    const label = make("label", `${title} `), box = make("select");
    for (const [value, text] of values) {
      const option = make("option", text, { value });
      option.selected = value === chosen;
      box.append(option);
    }
    box.addEventListener("change", () => changed(box.value));
    label.append(box);
    return label;
  };
  const unique = (values) => [...new Set(values.filter((v) => v !== null && v !== ""))];

  // tables: DataTables sorts and searches; a list above it for each column with few values
  for (const element of document.querySelectorAll("table.data")) {
    const table = new DataTable(element, {
      paging: false, info: false, order: [], autoWidth: false,
      layout: { topStart: null, topEnd: null, bottomStart: null, bottomEnd: null },
    });
    const tools = make("div", undefined, { class: "tools" });
    const search = make("label", "Search "), box = make("input", undefined, { type: "search" });
    box.addEventListener("input", () => table.search(box.value).draw());
    search.append(box);
    tools.append(search);
    element.querySelectorAll("thead th").forEach((head, index) => {
      if (!head.hasAttribute("data-filter")) return;
      const cells = [...element.querySelectorAll(`tbody tr > :nth-child(${index + 1})`)];
      const found = unique(cells.map((c) => c.textContent.trim())).sort();
      if (found.length < 2 || found.length > 100 || (cells.length > 8 && found.length > 0.6 * cells.length)) return;
      tools.append(select(head.dataset.filter, [["", "all"], ...found.map((v) => [v, v.slice(0, 60)])], "", (value) => {
        table.column(index).search((text) => value === "" || text.trim() === value).draw();
      }));
    });
    element.closest(".grid").before(tools);
  }

  // one list shows or hides the charts of a scenario
  const scenario = document.getElementById("scenario");
  if (scenario) {
    scenario.addEventListener("change", () => {
      for (const figure of document.querySelectorAll("figure[data-scenario]")) {
        figure.hidden = scenario.value !== "" && figure.dataset.scenario !== "" && figure.dataset.scenario !== scenario.value;
      }
    });
  }

  const shade = (colour) => css(`--${colour.slice(1)}`) || colour;
  const escape = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const short = (text) => (text.length > 40 ? `${text.slice(0, 39)}…` : text);
  const redraws = [];

  const explore = (holder) => {
    const data = JSON.parse(holder.querySelector("script").textContent);
    const columns = data.columns;
    for (const [name, column] of Object.entries(columns)) {
      if (!Array.isArray(column)) columns[name] = column.at.map((i) => column.words[i]);
    }
    const methods = unique(columns.integrator).sort();
    const label = (name) => data.labels[name] || name.replaceAll("_", " ");
    const state = { x: data.x, y: data.y, logX: true, logY: true, hidden: new Set(), picked: {} };
    const plot = holder.querySelector(".plot"), controls = holder.querySelector(".controls");
    for (const name of data.selects) {
      const values = unique(columns[name]);
      state.picked[name] = values[0];
      if (values.length > 1) {
        controls.append(select(name, values.map((v) => [v, short(v)]), values[0], (v) => { state.picked[name] = v; draw(); }));
      }
    }
    const axis = (key) => select(key, data.numeric.map((c) => [c, label(c)]), state[key], (v) => { state[key] = v; draw(); });
    const tick = (text, key) => {
      const wrap = make("label"), box = make("input", undefined, { type: "checkbox" });
      box.checked = state[key];
      box.addEventListener("change", () => { state[key] = box.checked; draw(); });
      wrap.append(box, ` ${text}`);
      return wrap;
    };
    controls.append(axis("x"), axis("y"), tick("log x", "logX"), tick("log y", "logY"));
    const list = holder.querySelector(".methods");
    for (const name of methods) {
      const wrap = make("label"), box = make("input", undefined, { type: "checkbox" });
      box.checked = true;
      box.addEventListener("change", () => { state.hidden[box.checked ? "delete" : "add"](name); draw(); });
      const swatch = make("span", undefined, { class: "swatch" });
      swatch.style.background = `var(--${(looks[name] || ["#7f7f7f"])[0].slice(1)},${(looks[name] || ["#7f7f7f"])[0]})`;
      wrap.append(box, swatch, ` ${short(name)}`);
      list.append(wrap);
    }

    const trace = (name, rows, top) => {
      const [colour, symbol, dash] = looks[name] || ["#7f7f7f", "circle", "solid"];
      const sorted = rows.map((i) => {
        const failed = columns.status && columns.status[i] !== "ok";
        let x = columns[state.x][i], y = columns[state.y][i];
        if (state.logY && y !== null) y = Math.abs(y);
        const usable = y !== null && (!state.logY || y > 0);
        return { x, y: usable ? y : failed ? top : null, failed, i };
      }).filter((p) => p.x !== null && p.y !== null).sort((a, b) => a.x - b.x);
      // no line leads to a failed run or on from it
      const points = sorted.flatMap((p, k) => (k && (p.failed || sorted[k - 1].failed) ? [{ ...p, y: null }, p] : [p]));
      return {
        type: "scatter", mode: "lines+markers", name: escape(short(name)), x: points.map((p) => p.x), y: points.map((p) => p.y),
        line: { color: shade(colour), dash, width: 1.5 },
        marker: { color: shade(colour), size: points.length > 80 ? 4 : 8, symbol: points.map((p) => (p.failed ? "x-open" : symbol)) },
        text: points.map((p) => escape(columns.status ? columns.status[p.i] : "")),
        hovertemplate: "%{x:.4g}, %{y:.4g}  %{text}", visible: state.hidden.has(name) ? "legendonly" : true,
      };
    };

    const draw = () => {
      const rows = columns.integrator.map((_, i) => i)
        .filter((i) => data.selects.every((name) => columns[name][i] === state.picked[name]));
      const ys = rows.map((i) => Math.abs(columns[state.y][i] ?? NaN)).filter((v) => v > 0);
      const top = ys.length ? Math.max(...ys) : 1;
      const present = methods.filter((name) => rows.some((i) => columns.integrator[i] === name));
      const narrow = plot.clientWidth < 600;
      const axisStyle = (name, log) => ({
        title: { text: escape(label(name)) }, type: log ? "log" : "linear", exponentformat: "power", gridcolor: css("--line"),
        zerolinecolor: css("--line"), automargin: true, nticks: 8,
      });
      Plotly.react(plot, present.map((name) => trace(name, rows.filter((i) => columns.integrator[i] === name), top)), {
        paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: css("--text"), size: 12 },
        margin: { l: 60, r: 10, t: 10, b: 50 }, xaxis: axisStyle(state.x, state.logX), yaxis: axisStyle(state.y, state.logY),
        showlegend: !narrow && present.length <= 20, hovermode: "closest", legend: { y: 1 },
        hoverlabel: { bgcolor: css("--panel"), font: { color: css("--text") } },
      }, { responsive: true, displayModeBar: false, typesetMath: false, modeBarButtonsToRemove: ["select2d", "lasso2d"] });
    };
    if (plot.clientWidth < 600 || methods.length > 20) holder.querySelector(".shown").open = true;
    redraws.push(draw);
    draw();
  };

  // an interactive chart is made when it comes into view or is opened: the page is there at once
  let loading = null;
  const plotly = () => {
    loading ||= (async () => {
      const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent), (c) => c.charCodeAt(0));
      const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
      const script = make("script", await new Response(stream).text());
      document.head.append(script);
    })();
    return loading;
  };
  const watcher = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (entry.isIntersecting) { watcher.unobserve(entry.target); plotly().then(() => explore(entry.target)); }
    }
  }, { rootMargin: "200px" });
  document.querySelectorAll(".explorer").forEach((holder) => watcher.observe(holder));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => redraws.forEach((draw) => draw()));
})();
