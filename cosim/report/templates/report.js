"use strict";
(() => {
  const NARROW = 640; // px; below it the panels of a figure stand in one column
  const PRINT_WIDTH = 680; // px; an A4 page less its margins
  const figures = [...document.querySelectorAll("[data-plot]")];
  const config = (id, narrow) => ({
    responsive: true,
    showSendToCloud: false, // plotly.js 4 offers an upload unless told not to
    plotlyServerURL: "",
    displayModeBar: !narrow, // it would lie over the legend
    displaylogo: false,
    modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"],
    toImageButtonOptions: { filename: id, scale: 2 },
  });
  const specs = new Map();

  const layout = (element, width) => {
    const { wide, narrow } = specs.get(element);
    return structuredClone(width < NARROW ? narrow : wide);
  };

  const draw = (element) => {
    const spec = JSON.parse(document.getElementById(element.dataset.plot).textContent);
    specs.set(element, spec);
    const width = element.clientWidth;
    element.replaceChildren();
    element.classList.toggle("narrow", width < NARROW);
    return Plotly.newPlot(element, spec.data, layout(element, width), config(element.id, width < NARROW));
  };

  const refit = (element) => {
    const narrow = element.clientWidth < NARROW;
    if (!specs.has(element) || narrow === element.classList.contains("narrow")) return;
    element.classList.toggle("narrow", narrow);
    Plotly.react(element, element.data, layout(element, element.clientWidth), config(element.id, narrow));
  };

  // one at a time, so that the page can be read while the figures appear
  const drawNext = (rest) => {
    if (!rest.length) return;
    draw(rest[0]);
    setTimeout(drawNext, 0, rest.slice(1));
  };
  if (figures.length) drawNext(figures);

  let waiting = 0;
  window.addEventListener("resize", () => {
    clearTimeout(waiting);
    waiting = setTimeout(() => figures.forEach(refit), 150);
  });

  const closed = new Set();
  window.addEventListener("beforeprint", () => {
    document.querySelectorAll("details:not([open])").forEach((d) => { closed.add(d); d.open = true; });
    figures.forEach((element) => {
      if (!specs.has(element)) draw(element);
      Plotly.relayout(element, { width: PRINT_WIDTH, autosize: false });
    });
  });
  window.addEventListener("afterprint", () => {
    closed.forEach((d) => { d.open = false; });
    closed.clear();
    figures.forEach((element) => Plotly.relayout(element, { width: null, autosize: true }));
  });
})();
