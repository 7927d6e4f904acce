// Play the motion of a mechanism: the deformed shape of one engine, and the tips of another over it.
"use strict";
(function () {
  const canvas = document.getElementById("animation");
  const manifest = JSON.parse(document.getElementById("manifest").textContent);
  const COLOURS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9", "#8a8f98", "#b8a800"];
  const colour = (engine) => COLOURS[manifest.engines.indexOf(engine) % COLOURS.length];
  const make = (tag, attributes, ...children) => {
    const node = Object.assign(document.createElement(tag), attributes);
    node.append(...children);
    return node;
  };

  function start(data) {
    const time = crosscheckDecode(data.time);
    const base = crosscheckDecode(data.base);
    const tips = Object.fromEntries(Object.entries(data.tips).map(([name, text]) => [name, crosscheckDecode(text)]));
    const points = data.links.reduce((sum, link) => sum + link.points, 0);
    const first = [];
    data.links.reduce((sum, link) => { first.push(sum); return sum + link.points; }, 0);
    const end = time.length - 1;
    const span = time[end] - time[0];
    const [low, high] = bounds();
    const flat = flatView();
    const state = { frame: 0, playing: false, other: Object.keys(tips)[0] || "", enlarged: 1, turn: flat[0], tilt: flat[1], last: 0 };

    function bounds() {
      const a = [Infinity, Infinity, Infinity], b = [-Infinity, -Infinity, -Infinity];
      for (let k = 0; k < base.length; k += 1) { a[k % 3] = Math.min(a[k % 3], base[k]); b[k % 3] = Math.max(b[k % 3], base[k]); }
      return [a, b];
    }

    // A mechanism that moves in a plane is looked at from above that plane, any other from a corner.
    function flatView() {
      const size = low.map((v, k) => high[k] - v);
      const thin = Math.max(...size) * 1e-3;
      if (size[2] <= thin) return [0, Math.PI / 2];
      if (size[1] <= thin) return [0, 0];
      if (size[0] <= thin) return [Math.PI / 2, 0];
      return [-0.6, 0.45];
    }

    const at = (array, columns, k, column) => {
      const a = Math.min(Math.floor(k), end), b = Math.min(a + 1, end), part = k - a;
      return [0, 1, 2].map((c) => array[(a * columns + column) * 3 + c] * (1 - part) + array[(b * columns + column) * 3 + c] * part);
    };

    function shapeOf(k) {
      return data.links.map((link, i) => Array.from({ length: link.points }, (_, p) => at(base, points, k, first[i] + p)));
    }

    // The other engine's links: its tip is known; between joint and tip the difference is spread evenly.
    function shapeOfOther(k, shape) {
      const gap = data.links.map((_, i) => {
        if (!data.known[state.other][i]) return [0, 0, 0];
        const tip = at(tips[state.other], data.links.length, k, i), own = shape[i][shape[i].length - 1];
        return tip.map((v, c) => state.enlarged * (v - own[c]));
      });
      return shape.map((line, i) => {
        const parent = data.links[i].parent;
        const from = parent < 0 ? [0, 0, 0] : gap[parent];
        return line.map((x, p) => {
          const part = line.length > 1 ? p / (line.length - 1) : 1;
          return x.map((v, c) => v + (1 - part) * from[c] + part * gap[i][c]);
        });
      });
    }

    function view() {
      const ratio = window.devicePixelRatio || 1;
      const wide = canvas.clientWidth, tall = canvas.clientHeight;
      if (canvas.width !== Math.round(wide * ratio) || canvas.height !== Math.round(tall * ratio)) {
        canvas.width = Math.round(wide * ratio);
        canvas.height = Math.round(tall * ratio);
      }
      const pen = canvas.getContext("2d");
      pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      pen.clearRect(0, 0, wide, tall);
      const [ct, st, ci, si] = [Math.cos(state.turn), Math.sin(state.turn), Math.cos(state.tilt), Math.sin(state.tilt)];
      const turned = (x) => { const a = ct * x[0] + st * x[1], b = -st * x[0] + ct * x[1]; return [a, b * si + x[2] * ci]; };
      const corners = [];
      for (let k = 0; k < 8; k += 1) corners.push(turned([k & 1 ? high[0] : low[0], k & 2 ? high[1] : low[1], k & 4 ? high[2] : low[2]]));
      const box = [0, 1].map((c) => [Math.min(...corners.map((q) => q[c])), Math.max(...corners.map((q) => q[c]))]);
      const scale = Math.min((wide - 60) / Math.max(box[0][1] - box[0][0], 1e-9), (tall - 60) / Math.max(box[1][1] - box[1][0], 1e-9));
      const middle = box.map((b) => (b[0] + b[1]) / 2);
      return { pen, wide, tall, turned, scale, place: (x) => { const q = turned(x); return [wide / 2 + scale * (q[0] - middle[0]), tall / 2 - scale * (q[1] - middle[1])]; } };
    }

    function stroke(v, line, style) {
      v.pen.beginPath();
      line.forEach((x, p) => { const q = v.place(x); if (p) v.pen.lineTo(q[0], q[1]); else v.pen.moveTo(q[0], q[1]); });
      Object.assign(v.pen, { lineCap: "round", lineJoin: "round" }, style);
      v.pen.setLineDash(style.dash || []);
      v.pen.stroke();
    }

    function dot(v, x, radius, fill, edge) {
      const q = v.place(x);
      v.pen.beginPath();
      v.pen.arc(q[0], q[1], radius, 0, 2 * Math.PI);
      v.pen.setLineDash([]);
      Object.assign(v.pen, { fillStyle: fill, strokeStyle: edge, lineWidth: 1.5 });
      if (fill) v.pen.fill();
      if (edge) v.pen.stroke();
    }

    function skeleton(v, shape, style, thin) {
      shape.forEach((line, i) => {
        const parent = data.links[i].parent;
        // A rigid link reaches from its joint to the joints that it carries.
        if (parent >= 0 && !data.links[parent].bends) stroke(v, [shape[parent][0], line[0]], { ...style, lineWidth: thin });
        if (line.length > 1) stroke(v, line, { ...style, lineWidth: data.links[i].bends ? style.lineWidth : thin });
      });
    }

    function draw() {
      const css = getComputedStyle(document.documentElement);
      const get = (name) => css.getPropertyValue(name).trim();
      const v = view();
      const shape = shapeOf(state.frame);
      axes(v, get("--muted"));
      data.links.forEach((link, i) => {
        if (data.links.some((other) => other.parent === i)) return;
        const path = Array.from({ length: end + 1 }, (_, k) => at(base, points, k, first[i] + link.points - 1));
        stroke(v, path, { strokeStyle: get("--line"), lineWidth: 1.5 });
      });
      skeleton(v, shape, { strokeStyle: colour(data.engine), lineWidth: 5 }, 4);
      shape.forEach((line) => dot(v, line[0], 4, get("--surface"), colour(data.engine)));
      if (state.other) {
        const other = shapeOfOther(state.frame, shape);
        skeleton(v, other, { strokeStyle: colour(state.other), lineWidth: 2, dash: [6, 4] }, 2);
        other.forEach((line, i) => { if (data.known[state.other][i]) dot(v, line[line.length - 1], 6, "", colour(state.other)); });
      }
      const now = time[0] + span * state.frame / Math.max(end, 1);
      slider.value = state.frame;
      slider.setAttribute("aria-valuetext", now.toFixed(3) + " s");
      clock.textContent = now.toFixed(3) + " s";
      canvas.dataset.drawn = now.toFixed(4);
    }

    function axes(v, ink) {
      const o = v.place([0, 0, 0]);
      const corner = [34, v.tall - 34];
      Object.assign(v.pen, { strokeStyle: ink, fillStyle: ink, lineWidth: 1, font: "12px system-ui, sans-serif" });
      v.pen.setLineDash([]);
      [["x", [1, 0, 0]], ["y", [0, 1, 0]], ["z", [0, 0, 1]]].forEach(([name, axis]) => {
        const q = v.turned(axis);
        if (Math.hypot(q[0], q[1]) < 0.05) return;
        v.pen.beginPath();
        v.pen.moveTo(corner[0], corner[1]);
        v.pen.lineTo(corner[0] + 22 * q[0], corner[1] - 22 * q[1]);
        v.pen.stroke();
        v.pen.fillText(name, corner[0] + 28 * q[0] - 3, corner[1] - 28 * q[1] + 4);
      });
      v.pen.strokeRect(o[0] - 4, o[1] - 4, 8, 8);
    }

    // One second of a motion takes a second, unless it is over too soon or too late to be looked at.
    const pace = end / Math.min(Math.max(span, 4), 12);
    function tick(now) {
      if (!state.playing) return;
      state.frame += pace * Math.min(0.1, (now - (state.last || now)) / 1000);
      state.last = now;
      if (state.frame >= end) state.frame = 0;
      draw();
      requestAnimationFrame(tick);
    }

    function play(on) {
      state.playing = on;
      state.last = 0;
      button.textContent = on ? "❚❚ Pause" : "▶ Play";
      button.setAttribute("aria-pressed", String(on));
      if (on) requestAnimationFrame(tick);
    }

    const slow = span / (end / pace);
    const button = make("button", { type: "button", className: "ghost", id: "play", onclick: () => play(!state.playing) });
    const slider = make("input", { type: "range", id: "moment", min: 0, max: end, step: "any", value: 0, oninput: () => { play(false); state.frame = Number(slider.value); draw(); } });
    const clock = make("output", {});
    const root = document.getElementById("animation-controls");
    root.append(button, make("label", { className: "time" }, "time ", slider, clock));
    if (state.other) {
      const other = make("select", { id: "other", onchange: () => { state.other = other.value; caption(); draw(); } });
      for (const name of Object.keys(tips)) other.append(make("option", { value: name, textContent: name }));
      const times = make("select", { id: "enlarged", onchange: () => { state.enlarged = Number(times.value); caption(); draw(); } });
      for (const k of [1, 10, 100, 1000, 10000]) times.append(make("option", { value: k, textContent: "× " + k }));
      root.append(make("label", {}, "over it ", other), make("label", {}, "difference ", times));
    }

    function caption() {
      const dashed = state.other ? "; dashed: " + state.other + (state.enlarged > 1 ? ", its difference × " + state.enlarged : "") : "";
      document.getElementById("caption-animation").textContent = "Motion of " + data.engine + dashed;
      const apart = state.other ? "Tips are at most " + data.apart[state.other].toExponential(1) + " m apart. " : "";
      const speed = Math.abs(slow - 1) > 0.01 ? "Shown at " + slow.toPrecision(2) + " of its speed." : "";
      document.getElementById("animation-note").textContent = apart + speed;
    }

    function turn(x, y) {
      state.turn += x;
      state.tilt = Math.min(Math.PI / 2, Math.max(-Math.PI / 2, state.tilt + y));
      draw();
    }

    canvas.addEventListener("keydown", (event) => {
      const arrows = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
      if (event.key === " ") play(!state.playing);
      else if (event.key === "Home") { [state.turn, state.tilt] = flat; draw(); }
      else if (arrows[event.key]) turn(...arrows[event.key]);
      else return;
      event.preventDefault();
    });
    let held = null;
    canvas.addEventListener("pointerdown", (event) => { held = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
    canvas.addEventListener("pointermove", (event) => {
      if (!held) return;
      turn(-(event.clientX - held[0]) / 150, (event.clientY - held[1]) / 150);
      held = [event.clientX, event.clientY];
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { held = null; });
    document.addEventListener("theme", draw);
    new ResizeObserver(draw).observe(canvas);
    play(false);
    caption();
    draw();
  }

  crosscheckLoad(manifest.slug + "/animation").then(start, (error) => {
    document.getElementById("animation-note").textContent = "The animation could not be loaded: " + error.message;
  });
})();
