// A plot: drawn once it comes near the window, in the colours of the moment, with a menu to keep it.
const coarse = matchMedia("(pointer: coarse)").matches; // a finger on a plot scrolls the page
const LOOK = { displayModeBar: false, responsive: true };
const plots = new Set();
const ROOM = 1.25; // at the ends of a log axis

// Colours are named by CSS variable, so that they follow the light.
function coloured(value) {
  if (typeof value === "string" && value.startsWith("--"))
    return getComputedStyle(document.documentElement).getPropertyValue(value).trim();
  if (Array.isArray(value)) return value.map(coloured);
  if (value && value.constructor === Object)
    return Object.fromEntries(Object.entries(value).map(([key, each]) => [key, coloured(each)]));
  return value;
}

// What is calculated meanwhile is as on paper.
function inLight(calculate) {
  const { classList } = document.documentElement, was = classList.contains("printing");
  classList.add("printing");
  const found = calculate();
  classList.toggle("printing", was);
  return found;
}

function axis(given) {
  return {
    gridcolor: "--line", linecolor: "--muted", tickcolor: "--muted", zeroline: false, showline: true, ticks: "outside",
    ticklen: 3, exponentformat: "power", automargin: true, ...given, title: { standoff: 6, ...given.title },
  };
}

// An axis between powers of ten.
function decades(ends, text) {
  return { type: "log", range: ends.map(Math.log10), ...powerTicks(...ends), title: { text } };
}

// Ticks at powers of ten, in decimals where they are short.
function powerTicks(least, greatest) {
  const [first, last] = [Math.ceil(Math.log10(least) - 1e-9), Math.floor(Math.log10(greatest) + 1e-9)];
  const step = last - first > 4 ? 2 : 1, powers = [];
  for (let power = first; power <= last; power += step) powers.push(power);
  const words = (power) => (power > -4 && power < 5 ? String(10 ** power) : `10<sup>${power}</sup>`.replace("-", "−"));
  return { tickvals: powers.map((power) => 10 ** power), ticktext: powers.map(words) };
}

// A log axis with some room at its ends, and ticks at round numbers.
function roomyLogAxis(least, greatest, text) {
  const range = [least / ROOM, greatest * ROOM], span = Math.log10(range[1] / range[0]);
  const ticks = span > 2 ? powerTicks(...range) : { tickvals: roundNumbers(...range, span > 1 ? [1, 3] : [1, 2, 5]) };
  return { type: "log", range: range.map(Math.log10), ...ticks, title: { text } };
}
function roundNumbers(least, greatest, digits) {
  const found = [];
  for (let power = Math.floor(Math.log10(least)); power <= Math.log10(greatest); power++)
    for (const digit of digits) found.push(+(digit * 10 ** power).toPrecision(1));
  return found.filter((value) => value >= least && value <= greatest);
}

function layout(given) {
  return {
    margin: { l: 58, r: 12, t: 6, b: 44 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    showlegend: false, dragmode: coarse ? false : "zoom", hovermode: "closest",
    font: { color: "--text", family: "system-ui, sans-serif", size: 12 },
    hoverlabel: { bgcolor: "--sheet", bordercolor: "--line", font: { color: "--text" } },
    ...given, xaxis: axis(given.xaxis), yaxis: axis(given.yaxis),
  };
}

const observer = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    target.near = isIntersecting;
    draw(target);
  }
}, { rootMargin: "300px" });

// Draw a plot that is to be seen and not as it should be; on paper all are seen.
function draw(place, paper = false) {
  if (!place.stale || !(place.near || paper) || !place.clientWidth) return;
  place.stale = false;
  const { data, layout } = place.figure();
  Plotly.react(place, coloured(data), coloured(layout), LOOK);
}
function redraw(place) {
  place.stale = true;
  draw(place);
}

// `figure` gives traces and layout, `rows` what is saved as CSV, its header first.
function plotOf(title, figure, rows, classes = "") {
  const place = element("div", { class: `plot ${classes}`, role: "img", "aria-label": title || "all cells" });
  Object.assign(place, { figure, stale: true });
  plots.add(place);
  observer.observe(place);
  const name = `${data.name} ${title}`.replace(/[^\p{L}\p{N}.=-]+/gu, "_").slice(0, 80);
  const button = (text, click) => element("button", { type: "button", click }, text);
  const menu = element("details", { class: "menu" },
    element("summary", { "aria-label": `Keep the plot ${title}` }, "⋯"),
    element("div", {},
      button("Save as PNG", () => picture(place, title, name, "png")),
      button("Save as SVG", () => picture(place, title, name, "svg")),
      button("Save data as CSV", () => save(`${name}.csv`, csv(rows()))),
      button("Reset zoom", () => { place.replaceChildren(); Plotly.purge(place); redraw(place); })));
  menu.addEventListener("click", (event) => { if (event.target.tagName === "BUTTON") menu.open = false; });
  menu.addEventListener("keydown", (event) => {
    if (event.key === "Escape") menu.open = false, menu.firstChild.focus();
  });
  return element("div", { class: "panel" }, element("div", { class: "head" }, ...(title ? [element("h3", {}, title)] : []), menu), place);
}
addEventListener("click", (event) => {
  for (const menu of document.querySelectorAll(".menu[open]")) if (!menu.contains(event.target)) menu.open = false;
});

function picture(place, title, filename, format) {
  const { data, layout } = inLight(() => coloured(place.figure()));
  const words = { text: escaped(title), font: { size: 13 } };
  const whole = { ...layout, title: words, showlegend: true, paper_bgcolor: "white", margin: { ...layout.margin, t: 40 } };
  return Plotly.downloadImage({ data, layout: whole }, { format, filename, width: 900, height: 560, scale: 2 });
}

function forget(panel) {
  const place = panel.querySelector(".plot");
  observer.unobserve(place);
  plots.delete(place);
  Plotly.purge(place);
}

// What is what, and a click that hides it on all plots of the section.
const SHAPES = {
  circle: "M13 7a4 4 0 1 0 8 0a4 4 0 1 0-8 0", square: "M13 3H21V11H13z", "triangle-up": "M17 2L22 11H12z",
  cross: "M15.5 2h3v3.5H22v3h-3.5V12h-3V8.5H12v-3h3.5z", x: "M13 2l4 4 4-4 1 1-4 4 4 4-1 1-4-4-4 4-1-1 4-4-4-4z",
  star: "M17 1l1.8 3.9 4.2.5-3.1 2.9.8 4.2-3.7-2.1-3.7 2.1.8-4.2L11 5.4l4.2-.5z", diamond: "M17 2l5 5-5 5-5-5z", "diamond-open": "M17 2l5 5-5 5-5-5z",
  "square-open": "M12 2H22V12H12z", "triangle-down": "M12 3H22L17 12z", "line-ew": "M12 7H22",
};
const paint = (color) => (color.startsWith("--") ? `var(${color})` : color);
function swatch({ line, area, marker }) {
  const part = (name, attributes) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    return made;
  };
  const drawing = part("svg", { viewBox: "0 0 34 14", "aria-hidden": "true" });
  if (area) drawing.append(part("path", { d: "M0 2H34V12H0z", fill: paint(area) }));
  if (line) drawing.append(part("path", { d: "M0 7H34", fill: "none", stroke: paint(line.color),
    "stroke-width": line.width ?? 1.6, "stroke-dasharray": line.dash === "solid" ? "none" : (line.dash ?? "none").replaceAll("px", "") }));
  if (marker) {
    const open = /open|line/.test(marker.symbol);
    drawing.append(part("path", { d: SHAPES[marker.symbol], fill: open ? "none" : paint(marker.color),
      stroke: paint(marker.color), "stroke-width": open ? 1.6 : 0 }));
  }
  return drawing;
}
function keyOf(curves, hidden, changed) {
  const entries = curves.map(({ name, look }) => {
    const button = element("button", { type: "button", "aria-pressed": "true", title: "click to hide or show" }, swatch(look), name);
    button.addEventListener("click", () => {
      if (!hidden.delete(name)) hidden.add(name);
      button.setAttribute("aria-pressed", !hidden.has(name));
      changed();
    });
    return element("li", {}, button);
  });
  return element("ul", { class: "key" }, ...entries);
}
const visible = (traces, hidden) => traces.filter((trace) => !hidden.has(trace.name));
