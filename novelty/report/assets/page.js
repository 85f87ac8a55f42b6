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
  const flatTheme = () => ({
    "font.color": cssColour("--quiet"), paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    "xaxis.gridcolor": cssColour("--line"), "yaxis.gridcolor": cssColour("--line"),
    "xaxis.zeroline": false, "yaxis.zeroline": false,
  });
  const sceneTheme = () => {
    const theme = { "font.color": cssColour("--quiet"), paper_bgcolor: "rgba(0,0,0,0)" };
    for (const axis of ["xaxis", "yaxis", "zaxis"]) {
      theme[`scene.${axis}.gridcolor`] = cssColour("--line");
      theme[`scene.${axis}.zerolinecolor`] = cssColour("--line");
    }
    return theme;
  };

  // The scene above a height is cut by the range of that axis; the box shrinks with it, so scales stay equal.
  const cutLayout = (fraction) => {
    const [low, high] = frame.heights;
    const top = low + fraction * (high - low);
    const span = frame.fullRange[1] - frame.fullRange[0];
    const range = frame.upSign > 0 ? [frame.fullRange[0], top] : [-top, frame.fullRange[1]];
    const ratio = frame.ratio[height[0]] * Math.max(range[1] - range[0], span / 100) / span;
    return { [`scene.${height}.range`]: range, [`scene.aspectratio.${height[0]}`]: ratio };
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
    await Promise.all(scenes.map((kind, place) =>
      Plotly.newPlot(views[place], figures[kind].data, figures[kind].layout, config)));
    if (figures.mdl) await Plotly.newPlot("view-mdl", figures.mdl.data, figures.mdl.layout, { ...config, scrollZoom: false });
    repaint();
    const cut = () => { sayTop(); views.forEach((view) => Plotly.relayout(view, cutLayout(slider.value / 100))); };
    cut();
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
