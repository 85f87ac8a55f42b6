"use strict";
// Colours follow the system until somebody chooses; the choice is kept where the browser lets a file keep anything.
(() => {
  const root = document.documentElement;
  const remembered = () => { try { return localStorage.getItem("novelty-theme") || ""; } catch { return ""; } };
  const remember = (theme) => { try { localStorage.setItem("novelty-theme", theme); } catch { /* not allowed */ } };
  const set = (theme) => {
    if (theme) root.dataset.theme = theme; else delete root.dataset.theme;
    for (const button of document.querySelectorAll("[data-set-theme]")) {
      button.setAttribute("aria-pressed", String(button.dataset.setTheme === theme));
    }
    document.dispatchEvent(new Event("themechange"));
  };
  set(remembered());
  document.addEventListener("DOMContentLoaded", () => {
    set(remembered());
    for (const button of document.querySelectorAll("[data-set-theme]")) {
      button.addEventListener("click", () => { remember(button.dataset.setTheme); set(button.dataset.setTheme); });
    }
  });
})();
