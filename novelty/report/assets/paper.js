"use strict";
(() => {
  const charts = JSON.parse(document.getElementById("figures").textContent);
  const config = { displaylogo: false, responsive: true, displayModeBar: false };
  const cssColour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  // Colours follow the page: light, dark, or paper.
  const themed = (layout) => {
    const axis = { gridcolor: cssColour("--line"), zerolinecolor: cssColour("--line") };
    return {
      ...layout, xaxis: { ...layout.xaxis, ...axis }, yaxis: { ...layout.yaxis, ...axis },
      font: { color: cssColour("--quiet"), family: getComputedStyle(document.body).fontFamily },
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    };
  };
  const draw = () => Promise.all([...document.querySelectorAll("[data-chart]")].map((place) => {
    const { data, layout } = charts[place.dataset.chart];
    return Plotly.react(place, data, themed(layout), config);
  }));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  matchMedia("print").addEventListener("change", draw);
  draw().then(() => { document.body.dataset.ready = "true"; });
})();
