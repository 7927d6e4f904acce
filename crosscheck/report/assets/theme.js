// What all pages share: light or dark, and tables that fit.
"use strict";
// Light or dark: what the reader chose, else what the system says.  Storage may be forbidden on file://.
(function () {
  const root = document.documentElement;
  const remember = (value) => { try { localStorage.setItem("theme", value); } catch (_) { /* not stored */ } };
  const recall = () => { try { return localStorage.getItem("theme"); } catch (_) { return null; } };
  const system = matchMedia("(prefers-color-scheme: dark)");
  const apply = (value) => {
    root.dataset.theme = value;
    root.style.colorScheme = value;
    document.dispatchEvent(new Event("theme"));
  };
  apply(recall() || (system.matches ? "dark" : "light"));
  system.addEventListener("change", () => { if (!recall()) apply(system.matches ? "dark" : "light"); });
  document.addEventListener("DOMContentLoaded", () => {
    document.getElementById("theme").addEventListener("click", () => {
      const value = root.dataset.theme === "dark" ? "light" : "dark";
      remember(value);
      apply(value);
    });
  });
})();

// A table that is wider than its box shows its rows as cards, each value beside the title of its column.  The matrix keeps its
// columns and scrolls beside the first one; its box fades at the side where there is more.
(function () {
  function label(table) {
    const titles = Array.from(table.tHead.rows[0].cells, (cell) => cell.textContent.trim());
    for (const row of Array.from(table.tBodies).flatMap((body) => Array.from(body.rows))) {
      Array.from(row.cells).forEach((cell, k) => {
        const value = document.createElement("div");
        value.append(...cell.childNodes);
        cell.append(value);
        cell.dataset.title = titles[k] || "";
      });
    }
    table.dataset.labelled = "yes";
  }

  function fit(box) {
    const table = box.querySelector(":scope > table");
    if (!table.tHead || table.matches(".matrix, .abilities")) {
      box.classList.toggle("more", box.scrollLeft + box.clientWidth < box.scrollWidth - 1);
      return;
    }
    table.classList.remove("stacked");
    if (table.scrollWidth <= box.clientWidth) return;
    if (!table.dataset.labelled) label(table);
    table.classList.add("stacked");
  }

  document.addEventListener("DOMContentLoaded", () => {
    const widths = new Map();
    const watch = new ResizeObserver((changes) => {
      for (const { target, contentRect } of changes) {
        if (widths.get(target) === contentRect.width) continue; // the height is our own doing
        widths.set(target, contentRect.width);
        if (contentRect.width > 0) fit(target);
      }
    });
    for (const box of document.querySelectorAll(".scroll:has(> table)")) {
      watch.observe(box);
      box.addEventListener("scroll", () => fit(box), { passive: true });
    }
  });
})();
