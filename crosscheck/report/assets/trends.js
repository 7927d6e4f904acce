// Draw the charts of a trend page with the plotly.js beside it; the numbers stand in the page.
"use strict";
(function () {
  const COLOURS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9", "#8a8f98", "#b8a800"];
  const DASHES = ["solid", "dash", "dot", "dashdot", "longdash", "5px 2px", "2px 2px", "8px 3px 2px 3px"];
  const plain = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const page = JSON.parse(document.getElementById("trends").textContent);
  const GOOD = new Set(["within", "explained", "ok", undefined, null]);
  const config = {
    showSendToCloud: false, plotlyServerURL: "", responsive: true, displaylogo: false, displayModeBar: "hover",
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"], toImageButtonOptions: { format: "svg" },
  };

  function trace(name, points, k, log) {
    // A logarithmic axis has no zero: a night without any error is left out of the curve.
    const kept = points.filter((p) => !log || p[1] > 0);
    return {
      type: "scatter", mode: "lines+markers", name: plain(name), x: kept.map((p) => p[0]), y: kept.map((p) => p[1]),
      text: kept.map((p) => page.axis[p[0]] + (p[2] ? ", " + p[2] : "")), hovertemplate: "%{text}<br>%{y:.3g}<extra>%{fullData.name}</extra>",
      line: { color: COLOURS[k % COLOURS.length], dash: DASHES[Math.floor(k / COLOURS.length) % DASHES.length], width: 1.5 },
      marker: { size: 7, color: COLOURS[k % COLOURS.length], symbol: kept.map((p) => (GOOD.has(p[2]) ? "circle" : "x")) },
    };
  }

  async function draw() {
    const css = getComputedStyle(document.documentElement);
    const get = (name) => css.getPropertyValue(name).trim();
    const axis = { gridcolor: get("--line"), zerolinecolor: get("--line"), linecolor: get("--line"), automargin: true, exponentformat: "power" };
    const every = Math.max(1, Math.ceil(page.axis.length / (innerWidth < 600 ? 4 : 10)));
    const ticks = page.axis.map((_, k) => k).filter((k) => k % every === 0);
    const upright = page.marks.map((m) => ({ type: "line", yref: "paper", x0: m.night, x1: m.night, y0: 0, y1: 1,
      line: { color: get("--muted"), width: 1, dash: "dot" } }));
    for (const [k, chart] of page.charts.entries()) {
      const names = Object.keys(chart.curves);
      const level = [chart.lower, chart.upper].filter((v) => v !== undefined && v !== null).map((v) => ({ type: "line", xref: "paper",
        x0: 0, x1: 1, y0: v, y1: v, line: { color: get("--deviation"), width: 1, dash: "dot" } }));
      const layout = {
        paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", hovermode: "closest", margin: { l: 8, r: 12, t: 12, b: 8 },
        font: { family: "system-ui, sans-serif", size: 12, color: get("--text") }, shapes: upright.concat(level),
        hoverlabel: { bgcolor: get("--surface"), bordercolor: get("--line"), font: { color: get("--text") } },
        modebar: { bgcolor: "rgba(0,0,0,0)", color: get("--muted"), activecolor: get("--text") },
        showlegend: names.length > 1, legend: { orientation: "h", y: -0.25 },
        xaxis: Object.assign({ tickmode: "array", tickvals: ticks, ticktext: ticks.map((t) => page.axis[t].slice(0, 10)), range: [-0.5, page.axis.length - 0.5] }, axis),
        yaxis: Object.assign({ type: chart.log ? "log" : "linear", rangemode: chart.log ? "normal" : "tozero" }, axis),
      };
      const node = document.getElementById("chart" + k);
      delete node.dataset.drawn;
      await Plotly.react(node, names.map((name, n) => trace(name, chart.curves[name], n, chart.log)), layout, config);
      node.dataset.drawn = chart.title;
    }
  }

  document.addEventListener("theme", draw);
  draw();
})();
