"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const quiet = { displayModeBar: false, responsive: true };
const coarse = matchMedia("(pointer: coarse)").matches; // a finger on a plot scrolls the page
const redraws = []; // what draws everything again in the colours of the moment

// Colours are named by CSS variable, so that they follow the light.
function coloured(value) {
  if (typeof value === "string" && value.startsWith("--"))
    return getComputedStyle(document.documentElement).getPropertyValue(value).trim();
  if (Array.isArray(value)) return value.map(coloured);
  if (value && value.constructor === Object)
    return Object.fromEntries(Object.entries(value).map(([key, each]) => [key, coloured(each)]));
  return value;
}

function axis(given) {
  return {
    gridcolor: "--line", linecolor: "--muted", tickcolor: "--muted", zeroline: false, showline: true, ticks: "outside",
    ticklen: 3, exponentformat: "power", automargin: true, ...given, title: { standoff: 6, ...given.title },
  };
}

function layout(given) {
  return coloured({
    margin: { l: 58, r: 12, t: 6, b: 44 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    showlegend: false, dragmode: coarse ? false : "zoom", hovermode: "closest",
    font: { color: "--text", family: "system-ui, sans-serif", size: 12 },
    hoverlabel: { bgcolor: "--sheet", bordercolor: "--line", font: { color: "--text" } },
    ...given, xaxis: axis(given.xaxis), yaxis: axis(given.yaxis),
  });
}

// Small multiples: each panel has its traces for each choice, or none.
function showGrid(section, grid) {
  const select = section.querySelector("select");
  const panels = [...section.querySelectorAll(".panel")];
  const draw = () => {
    const choice = select ? select.selectedIndex : 0;
    panels.forEach((panel, number) => {
      const traces = grid.panels[number][choice];
      panel.hidden = !traces;
      if (traces) Plotly.react(panel.querySelector(".plot"), coloured(traces), layout(grid.layouts[choice]), quiet);
    });
  };
  if (select) select.addEventListener("change", draw);
  redraws.push(draw);
}

// One lane in the plane, up to a time.
function floats(packed) {
  return new Float32Array(Uint8Array.from(atob(packed.bdata), (letter) => letter.charCodeAt(0)).buffer);
}

const [HONEST_AHEAD, ATTACKED_AHEAD] = [6, 7]; // [px] from a vehicle's middle to that of the diamond ahead of it

function showLanes(section, lanes) {
  const [select, play, slider, clock, plot, command] =
    ["select", "button", "input", "output", ".plot", "code"].map((name) => section.querySelector(name));
  let lane, timer;
  const choose = () => {
    const given = lanes[select.selectedIndex];
    lane = { ...given };
    for (const key of ["time", "x", "y", "ahead", "navigator_x", "navigator_y"]) lane[key] = floats(given[key]);
    slider.max = lane.time.length - 1;
    slider.value = slider.max;
    command.textContent = lane.command;
  };
  // Positions of some vehicles up to a frame, one path after the other.
  const paths = (vehicles, frame, from) => {
    const [x, y, m] = [[], [], lane.vehicles];
    for (const vehicle of vehicles) {
      for (let n = from; n <= frame; n++) x.push(lane.x[n * m + vehicle - 1]), y.push(lane.y[n * m + vehicle - 1]);
      if (from < frame) x.push(null), y.push(null);
    }
    return { x, y };
  };
  const draw = () => {
    const frame = +slider.value;
    const all = Array.from({ length: lane.vehicles }, (_, n) => n + 1);
    const honest = all.filter((vehicle) => !lane.attacked.includes(vehicle));
    const text = (vehicles) => vehicles.map((vehicle) => `vehicle ${vehicle}`);
    const trail = (vehicles, line) => ({ ...paths(vehicles, frame, 0), mode: "lines", line, hoverinfo: "skip" });
    const now = (vehicles, marker) =>
      ({ ...paths(vehicles, frame, frame), mode: "markers", marker, text: text(vehicles), hoverinfo: "text" });
    // A marker turns clockwise from up and stands off backwards, directions turn anticlockwise from x. Of a
    // narrow diamond, the same either way up, the front half looks out of the vehicle as a triangle.
    const ahead = (vehicles, color, standoff) => ({ ...paths(vehicles, frame, frame), mode: "markers", hoverinfo: "skip",
      marker: { color, symbol: "diamond-tall", size: 11, standoff,
        angle: vehicles.map((vehicle) => 270 - lane.ahead[frame * lane.vehicles + vehicle - 1]) } });
    const traces = [
      { x: lane.navigator_x, y: lane.navigator_y, mode: "lines", hoverinfo: "skip",
        line: { color: "--black", width: 1.5, dash: "2px,3px" } },
      trail(honest, { color: "--sky", width: 1.2 }),
      trail(lane.attacked, { color: "--red", width: 1.4, dash: "6px,2px" }),
      now(honest, { color: "--blue", symbol: "circle", size: 8 }),
      now(lane.attacked, { color: "--red", symbol: "diamond", size: 10 }),
      { x: [lane.navigator_x[frame]], y: [lane.navigator_y[frame]], mode: "markers", text: ["navigator"],
        hoverinfo: "text", marker: { color: "--black", symbol: "square-open", size: 13, line: { width: 2 } } },
      ahead(honest, "--blue", HONEST_AHEAD), ahead(lane.attacked, "--red", ATTACKED_AHEAD),
    ];
    const range = [-lane.reach, lane.reach];
    Plotly.react(plot, coloured(traces), layout({
      xaxis: { range: [...range], title: { text: "x [m]" }, constrain: "domain" },
      yaxis: { range: [...range], title: { text: "y [m]" }, scaleanchor: "x", constrain: "domain" },
      margin: { l: 62, r: 12, t: 6, b: 48 },
    }), quiet);
    clock.textContent = `t = ${lane.time[frame].toFixed(1)} s`;
    slider.setAttribute("aria-valuetext", clock.textContent);
  };
  const stop = () => { clearInterval(timer); timer = undefined; play.textContent = "Play"; };
  play.addEventListener("click", () => {
    if (timer) return stop();
    if (slider.value === slider.max) slider.value = 0;
    play.textContent = "Pause";
    timer = setInterval(() => { slider.stepUp(); draw(); if (slider.value === slider.max) stop(); }, 80);
  });
  slider.addEventListener("input", () => { stop(); draw(); });
  select.addEventListener("change", () => { stop(); choose(); draw(); });
  choose();
  redraws.push(draw);
}
for (const [id, given] of Object.entries(data))
  (id === "lanes" ? showLanes : showGrid)(document.getElementById(id), given);

// Tables sort by a click on a header; what is not a number comes last.
for (const head of document.querySelectorAll("th[aria-sort]")) {
  head.querySelector("button").addEventListener("click", () => {
    const body = head.closest("table").tBodies[0];
    const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    for (const other of head.parentElement.children) other.setAttribute("aria-sort", "none");
    head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
    const numeric = head.classList.contains("number");
    const keyed = [...body.rows].map((row) => {
      const cell = row.cells[head.cellIndex];
      return [numeric ? parseFloat(cell.dataset.value) : cell.textContent, row];
    });
    const last = (key) => numeric && Number.isNaN(key);
    keyed.sort(([a], [b]) => last(a) - last(b) || (a < b ? -sign : a > b ? sign : 0));
    body.append(...keyed.map(([, row]) => row));
  });
}

const redraw = () => redraws.forEach((draw) => draw());
redraw();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

// On paper it is light, and plots are as wide as a sheet: they are drawn before the sheet is laid out.
function layOut(printing) {
  document.documentElement.classList.toggle("printing", printing);
  for (const table of document.querySelectorAll("table")) {
    table.style.fontSize = "";
    const wide = table.scrollWidth / table.parentElement.clientWidth;
    if (printing && wide > 1) table.style.fontSize = `${0.98 / wide}em`;
  }
  redraw();
  for (const plot of document.querySelectorAll(".js-plotly-plot"))
    if (plot.clientWidth) Plotly.relayout(plot, printing ? { width: plot.clientWidth, height: plot.clientHeight }
      : { width: null, height: null, autosize: true });
}
addEventListener("beforeprint", () => layOut(true));
addEventListener("afterprint", () => layOut(false));
