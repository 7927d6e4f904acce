// Draw the plots of a page with the plotly.js beside it; the numbers of a quantity are loaded when asked for.
"use strict";
(function () {
  // Okabe and Ito's colours, told apart by colour-blind readers; dashes tell coinciding curves apart.
  const COLOURS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9", "#8a8f98", "#b8a800"];
  const DASHES = ["solid", "dash", "dot", "dashdot", "longdash", "5px 2px", "2px 2px", "8px 3px 2px 3px"];
  // plotly reads some tags in names and titles as markup; a name is a name.
  const plain = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const read = (id) => { const node = document.getElementById(id); return node && JSON.parse(node.textContent); };
  const loaded = {};
  const waiting = {};

  window.crosscheckData = (key, data) => { loaded[key] = data; (waiting[key] || (() => {}))(); };

  function load(key) {
    if (loaded[key]) return Promise.resolve(loaded[key]);
    return new Promise((resolve, reject) => {
      waiting[key] = () => resolve(loaded[key]);
      const script = document.createElement("script");
      script.src = "../data/" + key + ".js";
      script.onerror = () => reject(new Error("cannot load " + script.src));
      document.head.append(script);
    });
  }

  function decode(text) {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    return new Float32Array(bytes.buffer);
  }

  function style() {
    const css = getComputedStyle(document.documentElement);
    const get = (name) => css.getPropertyValue(name).trim();
    return { text: get("--text"), muted: get("--muted"), line: get("--line"), surface: get("--surface") };
  }

  function layout(x, y, extra) {
    const s = style();
    const axis = { gridcolor: s.line, zerolinecolor: s.line, linecolor: s.line, automargin: true, exponentformat: "power" };
    const base = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", showlegend: false, hovermode: "x unified",
      font: { family: "system-ui, sans-serif", size: 12, color: s.text },
      hoverlabel: { bgcolor: s.surface, bordercolor: s.line, font: { color: s.text } },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: s.muted, activecolor: s.text },
      margin: { l: 8, r: 12, t: 28, b: 8 }, shapes: [], annotations: [], dragmode: "zoom",
      xaxis: Object.assign({ title: { text: plain(x) } }, axis), yaxis: Object.assign({ title: { text: plain(y) } }, axis),
    };
    for (const key of Object.keys(extra || {})) {
      base[key] = key.endsWith("axis") ? Object.assign(base[key], extra[key]) : extra[key];
    }
    return base;
  }

  // plotly offers to send a chart to a server of its maker; here nothing leaves the machine.
  const config = {
    showSendToCloud: false, plotlyServerURL: "", responsive: true, displaylogo: false, displayModeBar: "hover",
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"], toImageButtonOptions: { format: "svg" },
  };
  const draw = (id, traces, lay) => Plotly.react(id, traces, lay, config);

  function make(tag, attributes, ...children) {
    const node = Object.assign(document.createElement(tag), attributes);
    node.append(...children);
    return node;
  }

  // ------------------------------------------------------------------ a case: overlay, difference, spectrum
  function casePage(manifest) {
    const state = { quantity: manifest.quantities[0], series: null, hidden: new Set(), log: false };
    const colour = (engine) => COLOURS[manifest.engines.indexOf(engine) % COLOURS.length];
    const dash = (engine) => DASHES[manifest.engines.indexOf(engine) % DASHES.length];
    const line = (engine, x, y) => ({
      type: "scatter", mode: "lines", name: plain(engine), x, y, line: { color: colour(engine), dash: dash(engine), width: 2 },
    });

    function band(engine, x, y, half) {
      const edge = (sign) => y.map((v, k) => v + sign * half[k]);
      const common = { type: "scatter", mode: "lines", x, hoverinfo: "skip", line: { width: 0 } };
      return [
        Object.assign({ y: edge(-1), name: plain(engine) + " lower" }, common),
        Object.assign({ y: edge(+1), name: plain(engine) + " upper", fill: "tonexty", fillcolor: colour(engine) + "33" }, common),
      ];
    }

    function overlay(time, one) {
      const traces = [];
      for (const engine of shown(one)) {
        const entry = one.engines[engine];
        const y = decode(entry.value);
        if (entry.error) traces.push(...band(engine, time, y, decode(entry.error)));
        traces.push(line(engine, time, y));
      }
      return draw("overlay", traces, layout("time [s]", state.series + " [" + one.unit + "]", { shapes: restMark() }));
    }

    function difference(time, one) {
      const traces = [];
      const shapes = restMark();
      let largest = 0;
      for (const engine of shown(one)) {
        if (!one.engines[engine].difference) continue;
        let y = decode(one.engines[engine].difference);
        for (const v of y) largest = Math.max(largest, Math.abs(v));
        if (state.log) y = y.map((v) => (v === 0 ? NaN : Math.abs(v)));
        traces.push(line(engine, time, y));
      }
      for (const engine of shown(one)) {
        const limit = one.limits[engine];
        // A limit far outside the curves would flatten them: it is drawn where it can be seen beside them.
        if (!limit || !(state.log || limit <= 4 * largest)) continue;
        for (const sign of state.log ? [1] : [1, -1]) {
          shapes.push({ type: "line", xref: "paper", x0: 0, x1: 1, y0: sign * limit, y1: sign * limit,
            line: { color: colour(engine), width: 1, dash: "dot" } });
        }
      }
      const what = (state.log ? "|difference|" : "difference") + " [" + one.unit + "]";
      const lay = layout("time [s]", what, { shapes, yaxis: { type: state.log ? "log" : "linear" } });
      if (!traces.length) lay.annotations = [nothing("one engine only: nothing to compare")];
      document.getElementById("caption-difference").textContent = "Difference from " + manifest.reference;
      return draw("difference", traces, lay);
    }

    function spectrum(one) {
      const figure = document.getElementById("spectrum").closest("figure");
      figure.hidden = !one.spectrum;
      if (!one.spectrum) return Promise.resolve();
      document.getElementById("caption-spectrum").textContent = manifest.spectrum;
      const x = decode(one.spectrum.frequency);
      const traces = [];
      let marked = null;
      for (const engine of shown(one)) {
        if (!one.spectrum.amplitude[engine]) continue;
        traces.push(line(engine, x, decode(one.spectrum.amplitude[engine])));
        const marks = one.spectrum.peaks[engine] || [];
        traces.push({ type: "scatter", mode: "markers", name: plain(engine) + " peak", x: marks.map((m) => m[0]), y: marks.map((m) => m[1]),
          marker: { color: colour(engine), symbol: "triangle-down", size: 9 }, hoverinfo: "skip" });
        if (marked === null) marked = marks;
      }
      // Lines far below the largest peak are the window's and the solver's: nothing to see.
      const tops = traces.filter((t) => t.mode === "lines").map((t) => Math.log10(t.y.reduce((a, b) => Math.max(a, b), 0)));
      const range = [Math.max(...tops) - 6, Math.max(...tops) + 0.7];
      const { labels, higher } = named(marked || [], x[x.length - 1] - x[0], range, figure);
      range[1] += higher;
      return draw("spectrum", traces, layout("frequency [Hz]", "amplitude [" + one.unit + "]", {
        annotations: labels, yaxis: { type: "log", range, dtick: 1 } }));
    }

    // Frequencies over their peaks [frequency, amplitude]; where two would lie over one another the smaller peak's stands higher,
    // and the axis goes up with it.  span [Hz] and range [decades] are those of the axes.
    function named(marks, span, range, figure) {
      const WIDE = 72, HIGH = 16, BESIDE = 105, BELOW = 120; // [px]: of a label; of what stands around the curves
      const across = Math.max(figure.clientWidth - BESIDE, WIDE) / span;
      const up = Math.max(figure.clientHeight - BELOW, 5 * HIGH) / (range[1] - range[0]);
      const placed = [];
      for (const mark of marks.slice().sort((a, b) => b[1] - a[1])) {
        const one = { mark, x: mark[0] * across, y: (Math.log10(mark[1]) - range[0]) * up + HIGH };
        const over = (p) => Math.abs(p.x - one.x) < WIDE && Math.abs(p.y - one.y) < HIGH;
        for (let p; (p = placed.find(over));) one.y = p.y + HIGH;
        placed.push(one);
      }
      const labels = placed.map((p) => ({
        x: p.mark[0], y: Math.log10(p.mark[1]), text: p.mark[0].toPrecision(4) + " Hz", showarrow: false,
        yshift: p.y - (Math.log10(p.mark[1]) - range[0]) * up,
      }));
      const excess = Math.max(0, ...placed.map((p) => p.y + HIGH - (range[1] - range[0]) * up));
      return { labels, higher: excess / up };
    }

    const shown = (one) => manifest.engines.filter((e) => one.engines[e] && !state.hidden.has(e));
    const nothing = (text) => ({ text, xref: "paper", yref: "paper", x: 0.5, y: 0.5, showarrow: false });

    function restMark() {
      return [{ type: "line", yref: "paper", x0: manifest.rest, x1: manifest.rest, y0: 0, y1: 1,
        line: { color: style().muted, width: 1, dash: "dot" } }];
    }

    async function show() {
      const root = document.getElementById("plots");
      delete root.dataset.drawn;
      try {
        const data = await load(manifest.slug + "/" + state.quantity.slug);
        const one = data.series[state.series];
        const time = decode(data.time);
        await Promise.all([overlay(time, one), difference(time, one), spectrum(one)]);
        document.getElementById("note").textContent =
          "The dotted upright line is where the prescribed motion comes to rest. Drag to zoom, double-click to return.";
      } catch (error) {
        document.getElementById("note").textContent = "The plots could not be drawn: " + error.message;
        throw error;
      }
      root.dataset.drawn = state.series;
    }

    function controls() {
      const root = document.getElementById("controls");
      const series = make("select", { id: "series", onchange: () => { state.series = series.value; show(); } });
      const quantity = make("select", { id: "quantity", onchange: () => choose(manifest.quantities[quantity.selectedIndex]) });
      for (const q of manifest.quantities) quantity.append(make("option", { value: q.name, textContent: q.name }));
      const choose = (q) => {
        state.quantity = q;
        state.series = q.series[0];
        series.replaceChildren(...q.series.map((name) => make("option", { value: name, textContent: name })));
        return show();
      };
      const engines = make("div", { className: "engines" });
      engines.setAttribute("role", "group");
      engines.setAttribute("aria-label", "Engines shown");
      for (const engine of manifest.engines) {
        const box = make("input", { type: "checkbox", checked: true, value: engine, onchange: () => {
          if (box.checked) state.hidden.delete(engine); else state.hidden.add(engine);
          show();
        } });
        const swatch = make("span", { className: "swatch" });
        swatch.style.background = colour(engine);
        engines.append(make("label", {}, box, swatch, engine));
      }
      const log = make("input", { type: "checkbox", id: "log", onchange: () => { state.log = log.checked; show(); } });
      root.append(make("label", {}, "quantity ", quantity), make("label", {}, "series ", series), engines,
        make("label", {}, log, " logarithmic difference"));
      return choose(manifest.quantities[0]);
    }

    document.addEventListener("theme", show);
    return controls();
  }

  // ------------------------------------------------------------------ a study: one plot of its columns
  function studyPage(plot) {
    const type = plot.log ? "log" : "linear";
    const traces = Object.entries(plot.curves).map(([name, curve], k) => ({
      type: "scatter", mode: "lines+markers", name: plain(name), x: curve.x, y: curve.y,
      line: { color: COLOURS[k % COLOURS.length], dash: DASHES[k % DASHES.length], width: 2 }, marker: { size: 8 },
    }));
    const show = async () => {
      const node = document.getElementById("study");
      delete node.dataset.drawn;
      await draw("study", traces, layout(plot.x, plot.y, {
        showlegend: traces.length > 1, legend: { orientation: "h", y: 1.12 }, xaxis: { type }, yaxis: plot.log ? { type, dtick: 1 } : {} }));
      node.dataset.drawn = "study";
    };
    document.addEventListener("theme", show);
    return show();
  }

  // ------------------------------------------------------------------ a study: curves over a common axis
  function studyFigures(figures) {
    const show = () => Promise.all(figures.map(async (figure, number) => {
      const traces = Object.entries(figure.curves).map(([name, curve], k) => ({
        type: "scatter", mode: "lines", name: plain(name), x: curve.x, y: curve.y,
        line: { color: COLOURS[k % COLOURS.length], dash: DASHES[k % DASHES.length], width: 2 },
      }));
      const node = document.getElementById("figure" + number);
      delete node.dataset.drawn;
      await draw("figure" + number, traces, layout(figure.x, figure.y, { showlegend: true, legend: { orientation: "h", y: 1.12 } }));
      node.dataset.drawn = "figure";
    }));
    document.addEventListener("theme", show);
    return show();
  }

  window.crosscheckLoad = load; // for the animation, whose numbers come the same way
  window.crosscheckDecode = decode;

  const manifest = read("manifest");
  const plot = read("studyplot");
  const figures = read("studyfigures");
  if (manifest) casePage(manifest);
  if (plot) studyPage(plot);
  if (figures) studyFigures(figures);
})();
