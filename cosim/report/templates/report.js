"use strict";
(() => {
  const NARROW = 640; // px; below it the panels of a figure stand in one column
  const PRINT_WIDTH = 680; // px; an A4 page less its margins
  const PRINT_HEIGHT = 820; // px, of a figure with its title and caption below it on one page
  const root = document.documentElement;
  const figures = [...document.querySelectorAll("[data-plot]")];
  if (figures.length) {
    // plotly: the page's policy knows its text
    const library = document.createElement("script");
    library.textContent = unpacked(document.getElementById("plotly"));
    document.head.append(library);
  }

  // ---- colors: what the system prefers, unless the reader chose; paper is white

  const system = matchMedia("(prefers-color-scheme: dark)");
  const shade = figures.length ? JSON.parse(document.getElementById("dark-colors").textContent) : {};
  let printing = false;
  const remembered = () => {
    try {
      return localStorage.getItem("theme");
    } catch {
      return null;
    }
  }; // a page from a file may have none
  const dark = () => !printing && (root.dataset.theme ? root.dataset.theme === "dark" : system.matches);
  const dyed = (value) => {
    if (typeof value === "string") return shade[value] ?? value;
    if (Array.isArray(value)) return value.map(dyed);
    if (ArrayBuffer.isView(value) || value === null || typeof value !== "object") return value;
    return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, dyed(item)]));
  };
  const colored = (value) => (dark() ? dyed(value) : structuredClone(value));

  // ---- figures

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

  const numbers = ([, kind, text, first, step]) => {
    const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
    if (kind === "u1") {
      let count = 0;
      return Float32Array.from(bytes, (more) => {
        count += more;
        return first + step * count;
      });
    }
    return kind === "f4" ? new Float32Array(bytes.buffer) : new Float64Array(bytes.buffer);
  };
  const spec = (element) => {
    if (!specs.has(element)) {
      const read = JSON.parse(unpacked(document.getElementById(element.dataset.plot)));
      const values = read.columns.map(numbers);
      for (const trace of read.data) {
        for (const axis of ["x", "y"]) if (Number.isInteger(trace[axis])) trace[axis] = values[trace[axis]];
      }
      specs.set(element, { ...read, values });
    }
    return specs.get(element);
  };
  const layout = (element, width) => colored(width < NARROW ? spec(element).narrow : spec(element).wide);

  // names of curves in lines that a narrow legend holds
  const broken = (name) => name.replace(/(.{20,40}?)\s(?=.{8})/g, "$1<br>");
  const traces = (element, narrow) => {
    const data = colored(spec(element).data);
    if (narrow)
      data.forEach((trace) => {
        trace.name = broken(trace.name);
      });
    return data;
  };

  // The height of a legend was guessed before its letters were drawn: where it needs more, the figure grows by it.
  const fit = (element) => {
    const legend = element.querySelector(".legend");
    if (!legend) return;
    const need = Math.ceil(legend.getBBox().height + 8 - element.layout.margin.t);
    if (need <= 0) return;
    Plotly.relayout(element, { "margin.t": element.layout.margin.t + need, height: element.layout.height + need });
  };

  const draw = (element) => {
    const width = element.clientWidth,
      narrow = width < NARROW;
    if (!element.classList.contains("js-plotly-plot")) element.replaceChildren();
    element.classList.toggle("narrow", narrow);
    Plotly.react(element, traces(element, narrow), layout(element, width), config(element.id, narrow));
    fit(element);
  };

  const refit = (element) => {
    if (specs.has(element) && element.clientWidth < NARROW !== element.classList.contains("narrow")) draw(element);
  };
  const redraw = () =>
    figures.forEach((element) => {
      if (specs.has(element)) draw(element);
    });

  // one at a time, so that the page can be read while the figures appear
  const drawNext = (rest) => {
    if (!rest.length) return;
    if (!specs.has(rest[0])) draw(rest[0]);
    setTimeout(drawNext, 0, rest.slice(1));
  };

  let waiting = 0;
  window.addEventListener("resize", () => {
    clearTimeout(waiting);
    waiting = setTimeout(() => {
      figures.forEach(refit);
      showScrolling();
    }, 150);
  });

  // tables that are wider than the page say so
  const showScrolling = () =>
    document
      .querySelectorAll(".table")
      .forEach((table) => table.classList.toggle("scrolls", table.scrollWidth > table.clientWidth + 1));
  showScrolling();
  document.querySelectorAll("details").forEach((box) => box.addEventListener("toggle", showScrolling));

  // ---- the reader's choice

  const button = document.querySelector("button.theme");
  const recolored = () => {
    button.textContent = dark() ? "Light colors" : "Dark colors";
    redraw();
    window.dispatchEvent(new Event("recolored"));
  };
  button.hidden = false;
  button.addEventListener("click", () => {
    root.dataset.theme = dark() ? "light" : "dark";
    try {
      localStorage.setItem("theme", root.dataset.theme);
    } catch {
      /* not remembered */
    }
    recolored();
  });
  system.addEventListener("change", recolored);
  if (["light", "dark"].includes(remembered())) root.dataset.theme = remembered();
  recolored();
  drawNext(figures);

  // ---- files, from what is in the page

  const save = (name, kind, text) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type: kind }));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  };
  // the shortest digits that read back to the same number
  const digits = (value, single) => {
    if (Number.isNaN(value)) return "nan";
    if (!Number.isFinite(value)) return value > 0 ? "inf" : "-inf";
    if (!single) return String(value);
    for (let count = 1; count < 9; count += 1) {
      if (Math.fround(Number(value.toPrecision(count))) === value) return String(Number(value.toPrecision(count)));
    }
    return String(Number(value.toPrecision(9)));
  };
  const quoted = (text) => (/[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const csv = (rows) => rows.map((row) => row.map(quoted).join(",")).join("\n") + "\n";

  const figureRows = (element) => {
    const { columns, values } = spec(element);
    const length = Math.max(...values.map((v) => v.length));
    const rows = Array.from({ length }, (_, i) =>
      values.map((v, k) => (i < v.length ? digits(v[i], v instanceof Float32Array) : "")),
    );
    return [columns.map(([header]) => header), ...rows];
  };
  const tableRows = (table) =>
    [...table.rows].map((row) =>
      [...row.cells].map((cell) => {
        const data = cell.querySelector("data");
        return data ? data.value : cell.textContent;
      }),
    );

  document.querySelectorAll("a[data-csv]").forEach((link) => {
    const name = link.getAttribute("href").split("/").pop();
    link.addEventListener("click", (event) => {
      event.preventDefault();
      const figure = link.closest("figure");
      const rows = figure
        ? figureRows(figure.querySelector(".plot"))
        : tableRows(document.querySelector(`#${link.dataset.csv} table`));
      save(name, "text/csv", csv(rows));
    });
    if (!link.closest("figure")) return;
    const svg = document.createElement("button");
    svg.type = "button";
    svg.textContent = "SVG";
    svg.setAttribute("aria-label", link.getAttribute("aria-label").replace("CSV", "SVG"));
    svg.addEventListener("click", async () => {
      const element = link.closest("figure").querySelector(".plot");
      const { data, wide } = spec(element); // as on a wide page and on white, whatever the screen
      const scratch = document.createElement("div");
      scratch.className = "scratch";
      document.body.append(scratch);
      await Plotly.newPlot(
        scratch,
        data,
        { ...structuredClone(wide), width: 900, autosize: false },
        { staticPlot: true },
      );
      fit(scratch);
      const image = await Plotly.toImage(scratch, { format: "svg", width: 900, height: scratch.layout.height });
      Plotly.purge(scratch);
      scratch.remove();
      save(name.replace(/csv$/, "svg"), "image/svg+xml", decodeURIComponent(image.slice(image.indexOf(",") + 1)));
    });
    link.after(svg);
  });

  // ---- paper

  const closed = new Set();
  const shrunk = [];
  const narrowest = (table) => {
    // px, as wide as the longest word or number of each column
    table.style.width = "min-content";
    const width = table.offsetWidth;
    table.style.width = "";
    return width;
  };
  window.addEventListener("beforeprint", () => {
    printing = true;
    document.querySelectorAll("details:not([open])").forEach((d) => {
      closed.add(d);
      d.open = true;
    });
    document.querySelectorAll(".table table").forEach((table) => {
      const width = narrowest(table) * 0.8; // print has smaller letters
      if (width > PRINT_WIDTH) {
        table.style.zoom = PRINT_WIDTH / width;
        shrunk.push(table);
      }
    });
    figures.forEach((element) => {
      draw(element);
      Plotly.relayout(element, {
        width: PRINT_WIDTH,
        height: Math.min(element.layout.height, PRINT_HEIGHT),
        autosize: false,
      });
    });
    window.dispatchEvent(new Event("recolored"));
  });
  window.addEventListener("afterprint", () => {
    printing = false;
    closed.forEach((d) => {
      d.open = false;
    });
    closed.clear();
    shrunk.splice(0).forEach((table) => {
      table.style.zoom = "";
    });
    redraw();
    window.dispatchEvent(new Event("recolored"));
  });
})();
