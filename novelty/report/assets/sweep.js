"use strict";
(() => {
  const { effects, plots } = JSON.parse(document.getElementById("figures").textContent);
  const config = { displaylogo: false, responsive: true, displayModeBar: false };
  // What is drawn for paper; its style cannot be asked for before it is laid out. The width fits A4 and Letter.
  const PAPER = { width: 680, height: 300, "--line": "#bbb", "--quiet": "#444" };
  let onPaper = false;
  const [study, scores] = Object.entries(effects)[0] ?? [null, {}];
  const chosen = { study, metric: Object.keys(scores)[0], band: "interval", layers: ["points"] };
  const drawn = new Map();  // element -> whether it is a 3D scene

  const cssColour = (name) => (onPaper ? PAPER[name]
    : getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  const all = (selector) => [...document.querySelectorAll(selector)];

  // Colours follow the page: light, dark, or paper.
  const axisTheme = () => ({ gridcolor: cssColour("--line"), linecolor: cssColour("--line") });
  const themed = (layout, scene) => {
    const axes = scene ? ["xaxis", "yaxis", "zaxis"] : ["xaxis", "yaxis"];
    const place = scene ? layout.scene : layout;
    for (const axis of axes) place[axis] = { ...place[axis], ...axisTheme() };
    const font = { color: cssColour("--quiet"), family: getComputedStyle(document.body).fontFamily };
    return { ...layout, font, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)" };
  };
  // Where a row of a 3D view's legend would be cut, its entries stand below each other.
  const narrowed = (layout, data, width) => {
    if (width >= 480) return layout;
    const entries = data.filter((trace) => trace.showlegend).length;
    const legend = { ...layout.legend, orientation: "v", x: 0, tracegroupgap: 0 };
    return { ...layout, legend, margin: { ...layout.margin, b: 20 * entries } };
  };
  const draw = (element, figure, scene = false) => {
    drawn.set(element, scene);
    const layout = scene ? narrowed(figure.layout, figure.data, element.clientWidth) : figure.layout;
    return Plotly.react(element, figure.data, themed(structuredClone(layout), scene),
      { ...config, scrollZoom: scene });
  };
  const repaint = () => {
    for (const [element, scene] of drawn) {
      if (element.layout) Plotly.react(element, element.data, themed({ ...element.layout }, scene), element._context);
    }
  };

  const fit = (paper) => {
    onPaper = paper;
    repaint();
    const { width, height } = paper ? PAPER : { width: null, height: null };
    for (const [element, scene] of drawn) {
      if (element.layout && !scene) Plotly.relayout(element, { width, height, autosize: !paper });
    }
  };

  // Buttons of one group: the pressed one says what is shown.
  const choice = (attribute, select) => {
    const buttons = all(`[data-${attribute}]`);
    const key = attribute.replace(/-(\w)/g, (_, letter) => letter.toUpperCase());
    for (const button of buttons) {
      button.addEventListener("click", () => {
        for (const other of buttons) other.setAttribute("aria-pressed", String(other === button));
        select(button.dataset[key], button);
      });
    }
  };

  const drawEffect = () => {
    if (!chosen.study) return Promise.resolve();
    const { data, layout } = structuredClone(effects[chosen.study][chosen.metric]);
    for (const trace of data) {
      if (trace.meta && trace.meta.band) trace.visible = trace.meta.band === chosen.band;
    }
    for (const element of all("[data-of-study]")) element.hidden = element.dataset.ofStudy !== chosen.study;
    for (const element of all("[data-metric-table]")) element.hidden = element.dataset.metricTable !== chosen.metric;
    return draw(document.getElementById("effect"), { data, layout });
  };

  const showLayers = (figure) => {
    for (const trace of figure.data) trace.visible = chosen.layers.includes(trace.meta.layer);
    return figure;
  };
  const views = () => ["added", "removed"].map((side) => document.getElementById(`view-${side}`));
  const showRun = async (row, button) => {
    const viewer = document.getElementById("viewer");
    viewer.hidden = false;
    viewer.dataset.run = row;
    document.getElementById("viewer-name").textContent = button.dataset.name;
    const figures = JSON.parse(document.getElementById(`run-${row}`).textContent);
    await Promise.all(views().map((view) => draw(view, showLayers(figures[view.id.slice(5)]), true)));
    viewer.dataset.drawn = row;
    viewer.scrollIntoView({ behavior: "smooth", block: "nearest" });
  };
  const redrawLayers = () => {
    for (const view of views()) if (view.data) { showLayers(view); Plotly.redraw(view); }
  };

  const start = async () => {
    choice("study", (study) => { chosen.study = study; drawEffect(); });
    choice("metric", (metric) => { chosen.metric = metric; drawEffect(); });
    choice("band", (band) => { chosen.band = band; drawEffect(); });
    choice("compared", (column) => {
      for (const element of all("[data-of-compared]")) element.hidden = element.dataset.ofCompared !== column;
    });
    choice("run", showRun);
    choice("layers", (layers) => { chosen.layers = layers.split(" "); redrawLayers(); });
    await drawEffect();
    await Promise.all(Object.entries(plots).map(([name, figure]) => {
      const element = document.getElementById(`plot-${name}`);
      return element ? draw(element, figure) : null;
    }));
    document.addEventListener("themechange", repaint);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
    window.addEventListener("beforeprint", () => fit(true));
    window.addEventListener("afterprint", () => fit(false));
    document.body.dataset.ready = "true";
  };
  start();
})();
