"use strict";
(() => {
  const { figures, frame } = JSON.parse(document.getElementById("figures").textContent);
  const scenes = Object.keys(figures).filter((kind) => kind !== "mdl");
  const views = scenes.map((kind) => document.getElementById(`view-${kind}`));
  const startingCamera = structuredClone(figures[scenes[0]].layout.scene.camera);
  const height = ["xaxis", "yaxis", "zaxis"][frame.upAxis];
  const config = { displaylogo: false, responsive: true, displayModeBar: false, scrollZoom: true };

  const cssColour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  // Colours follow the page: light, dark, or paper.
  const common = () => ({
    "font.color": cssColour("--quiet"), "font.family": getComputedStyle(document.body).fontFamily,
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
  });
  const gridOf = (prefix, axes) => Object.fromEntries(axes.flatMap((axis) => [
    [`${prefix}${axis}.gridcolor`, cssColour("--line")], [`${prefix}${axis}.zerolinecolor`, cssColour("--line")],
  ]));
  const sceneTheme = () => ({ ...common(), ...gridOf("scene.", ["xaxis", "yaxis", "zaxis"]) });
  const flatTheme = () => ({ ...common(), ...gridOf("", ["xaxis", "yaxis"]) });

  // The scene above a height is cut by the range of that axis; the box shrinks with it, so scales stay equal.
  const cutLayout = (fraction) => {
    const [low, high] = frame.heights;
    const top = low + Math.max(fraction, 0.01) * (high - low);
    const span = frame.fullRange[1] - frame.fullRange[0];
    const range = frame.upSign > 0 ? [frame.fullRange[0], top] : [-top, frame.fullRange[1]];
    const ratio = frame.ratio[height[0]] * (range[1] - range[0]) / span;
    return { [`scene.${height}.range`]: range, [`scene.aspectratio.${height[0]}`]: ratio };
  };

  // Writes dotted keys into a layout before it is drawn, so that the first drawing is the only one.
  const withKeys = (layout, keys) => {
    for (const [dotted, value] of Object.entries(keys)) {
      const parts = dotted.split(".");
      const leaf = parts.pop();
      parts.reduce((place, part) => (place[part] ??= {}), layout)[leaf] = value;
    }
    return layout;
  };

  // Where a row of the legend would be cut, its entries stand below each other.
  const legendKeys = (data, width) => {
    const entries = data.filter((trace) => trace.showlegend).length;
    if (width >= 480) return {};
    return { "legend.orientation": "v", "legend.x": 0, "legend.tracegroupgap": 0, "margin.b": 20 * entries };
  };

  const slider = document.getElementById("top");
  const shownTop = document.getElementById("top-value");
  const sayTop = () => {
    const [low, high] = frame.heights;
    const top = low + (slider.value / 100) * (high - low);
    shownTop.textContent = slider.value === "100" ? "nothing" : `${top.toFixed(2)} ${frame.unit}`;
  };

  const showLayers = (layers) => {
    for (const view of views) {
      view.data.forEach((trace) => { trace.visible = layers.includes(trace.meta.layer); });
      Plotly.redraw(view);
    }
    for (const button of document.querySelectorAll("[data-layers]")) {
      button.setAttribute("aria-pressed", String(button.dataset.layers === layers.join(" ")));
    }
  };

  const followEachOther = () => {
    let following = false;
    const pass = (from) => (change) => {
      const camera = change && change["scene.camera"];
      if (!camera || following) return;
      following = true;
      const others = views.filter((view) => view !== from);
      Promise.all(others.map((view) => Plotly.relayout(view, { "scene.camera": camera })))
        .finally(() => { following = false; });
    };
    for (const view of views) {
      view.on("plotly_relayout", pass(view));
      view.on("plotly_relayouting", pass(view));
    }
  };

  const repaint = () => {
    views.forEach((view) => Plotly.relayout(view, sceneTheme()));
    if (figures.mdl) Plotly.relayout("view-mdl", flatTheme());
  };

  const start = async () => {
    slider.value = Math.ceil(100 * frame.top);
    sayTop();
    await Promise.all(scenes.map((kind, place) => {
      const { data, layout } = figures[kind];
      const keys = { ...sceneTheme(), ...cutLayout(slider.value / 100), ...legendKeys(data, views[place].clientWidth) };
      return Plotly.newPlot(views[place], data, withKeys(layout, keys), config);
    }));
    if (figures.mdl) {
      const { data, layout } = figures.mdl;
      await Plotly.newPlot("view-mdl", data, withKeys(layout, flatTheme()), { ...config, scrollZoom: false });
    }
    const cut = () => {
      sayTop();
      views.forEach((view) => Plotly.relayout(view, cutLayout(slider.value / 100)));
    };
    slider.addEventListener("input", cut);
    for (const button of document.querySelectorAll("[data-layers]")) {
      button.addEventListener("click", () => showLayers(button.dataset.layers.split(" ")));
    }
    document.getElementById("reset").addEventListener("click", () => {
      views.forEach((view) => Plotly.relayout(view, { "scene.camera": structuredClone(startingCamera) }));
    });
    followEachOther();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
    matchMedia("print").addEventListener("change", repaint);
    document.body.dataset.ready = "true";
  };
  start();
})();
