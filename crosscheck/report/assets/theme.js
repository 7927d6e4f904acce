// Light or dark: what the reader chose, else what the system says.  Storage may be forbidden on file://.
"use strict";
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
