// Plots: figures that Python made, drawn as they come near the window, in the light of the moment.
const PAGE = 24; // panels
const coarse = matchMedia("(pointer: coarse)").matches; // a finger on a plot scrolls the page
const dark = matchMedia("(prefers-color-scheme: dark)");
const plots = all(".plot");

// Arrays are packed as plotly packs them.
const TYPES = { f4: Float32Array, u1: Uint8Array };
function numbers(given) {
  if (!given.bdata) return given;
  const bytes = Uint8Array.from(atob(given.bdata), (letter) => letter.charCodeAt(0));
  return new TYPES[given.dtype](bytes.buffer);
}

// Colours are named as CSS names them, which knows the light.
function coloured(text) {
  const style = getComputedStyle(document.documentElement);
  return text.replace(/"(--\w+)"/g, (_, name) => `"${style.getPropertyValue(name).trim()}"`);
}

const AXIS = {
  gridcolor: "--line", linecolor: "--muted", tickcolor: "--muted", zeroline: false, showline: true,
  ticks: "outside", ticklen: 3, exponentformat: "power", automargin: true, title: { standoff: 6 },
};
const MARGIN = { l: 58, r: 12, t: 6, b: 44 };
const TEMPLATE = JSON.stringify({
  layout: {
    margin: MARGIN, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    showlegend: false, hovermode: "closest", dragmode: coarse ? false : "zoom",
    font: { color: "--text", family: "system-ui, sans-serif", size: 12 },
    hoverlabel: { bgcolor: "--sheet", bordercolor: "--line", font: { color: "--text" } },
    xaxis: AXIS, yaxis: AXIS,
  },
});

for (const place of plots) {
  const given = place.nextElementSibling; // the figure as JSON
  Object.assign(place, { stale: true, figure: () => given.textContent, finish: () => {} });
}

// The values of cells that are chosen, null for others.
const ofChosen = (values, cells) => values.map((value, n) =>
  Array.isArray(value) ? ofChosen(value, cells[n]) : shown[cells[n]] ? value : null);

// What plotly draws: of the cells chosen, without the curves that the key hides.
function figureOf(place, width = place.clientWidth) {
  const figure = JSON.parse(coloured(place.figure()));
  const time = figure.x && numbers(figure.x);
  const pressed = all('.key [aria-pressed="false"]', place.closest(".view"));
  const hidden = pressed.map(({ dataset }) => dataset.name);
  for (const trace of figure.data) {
    const cells = trace.meta?.cells; // one for each point
    if (cells) trace[trace.z ? "z" : "x"] = ofChosen(trace.z ?? trace.x, cells);
    if (time) trace.x = time;
    if (figure.floor) trace.y = numbers(trace.y).map((y) => Math.max(figure.floor, y));
    if (trace.texttemplate) fit(trace, width);
    if (hidden.includes(trace.name)) trace.visible = false;
  }
  place.finish(figure);
  figure.layout.template = JSON.parse(coloured(TEMPLATE));
  return figure;
}

// Texts of tiles as large as the longest has room; plotly counts the letters of their colours too.
function fit(trace, width) {
  const { side, letters } = trace.meta, tile = (width - side) / trace.z[0].length; // [px]
  if (tile < 42) trace.text = trace.text.map((row) => row.map((words) => words.split("<br>")[0]));
  const most = tile < 42 ? letters[0] : Math.max(...letters);
  trace.textfont.size = Math.max(1, Math.min(12, (1.5 * tile) / most));
}

// Draw a plot that is to be seen and not as it should be. On paper all are seen.
function draw(place) {
  if (!place.stale || !(place.near || printing) || !place.clientWidth) return;
  place.stale = false;
  const { data: traces, layout } = figureOf(place), isNew = !place.data;
  Plotly.react(place, traces, layout, { displayModeBar: false, responsive: true });
  if (isNew) place.on("plotly_hover", ({ points: [{ hovertext }] }) => tell(place, hovertext));
}

// Tiles of a heat map tell their cells, when they are pointed at or reached by arrow keys.
function tell(place, words) {
  const told = place.closest(".tiles")?.querySelector(".told");
  if (told) told.innerHTML = words;
}
const ARROWS = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };
document.addEventListener("keydown", (event) => {
  const place = event.target, step = ARROWS[event.key];
  if (!step || !place.matches(".tiles .plot")) return;
  event.preventDefault();
  const [row, column] = place.tile ? place.tile.map((at, n) => at + step[n]) : [0, 0];
  const words = place.data[0].hovertext[row]?.[column];
  if (words === undefined) return;
  place.tile = [row, column];
  Plotly.Fx.hover(place, { xval: column, yval: row });
  tell(place, words);
});
function redraw(place) {
  place.stale = true;
  draw(place);
}
const observer = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    target.near = isIntersecting;
    draw(target);
  }
}, { rootMargin: "300px" });
plots.forEach((place) => observer.observe(place));
dark.addEventListener("change", () => plots.forEach(redraw));
document.addEventListener("views", () => plots.forEach(redraw));
document.addEventListener("paper", () => {
  for (const place of plots) {
    redraw(place);
    if (!place.layout || !place.clientWidth) continue;
    const size = { width: place.clientWidth, height: place.clientHeight };
    const free = { width: null, height: null, autosize: true };
    Plotly.relayout(place, printing ? size : free);
  }
});

// Many panels are shown page by page.
function turn(grid, to) {
  const panels = all(".panel:not(.other)", grid), most = Math.ceil(panels.length / PAGE) - 1;
  const page = Math.max(0, Math.min(to, most)), first = page * PAGE;
  grid.page = page;
  panels.forEach((panel, n) => panel.classList.toggle("later", Math.floor(n / PAGE) !== page));
  const pager = grid.previousElementSibling, [told, back, next] = pager.children;
  pager.hidden = panels.length <= PAGE;
  told.textContent = `${first + 1} to ${Math.min(panels.length, first + PAGE)} of ${panels.length}`;
  back.disabled = page === 0;
  next.disabled = page === most;
  back.onclick = () => turn(grid, page - 1);
  next.onclick = () => turn(grid, page + 1);
  for (const place of all(".later .plot", grid)) {
    Plotly.purge(place); // thousands of paths would slow the page down
    place.stale = true;
  }
}
document.addEventListener("chosen", () => {
  for (const grid of all(".grid")) turn(grid, 0);
  plots.forEach(redraw);
});

// A click on a key hides a curve in its section. The menu of a plot keeps it.
document.addEventListener("click", ({ target }) => {
  const entry = target.closest(".key button");
  if (entry) {
    entry.setAttribute("aria-pressed", entry.getAttribute("aria-pressed") === "false");
    all(".plot", entry.closest(".view")).forEach(redraw);
  }
  for (const menu of all(".menu[open]"))
    if (!menu.contains(target) || target.dataset.keep) menu.open = false;
  const { keep: format } = target.dataset;
  if (format) keep(target.closest(".panel").querySelector(".plot"), format);
});
document.addEventListener("keydown", ({ key, target }) => {
  const menu = key === "Escape" && target.closest(".menu[open]");
  if (!menu) return;
  menu.open = false;
  menu.firstElementChild.focus();
});

function keep(place, format) {
  const name = `${data.name} ${place.ariaLabel}`.replace(/[^\p{L}\p{N}.=-]+/gu, "_").slice(0, 80);
  if (format === "csv") return save(`${name}.csv`, csv(place.rows?.() ?? rowsOf(place)));
  if (format === "zoom") {
    Plotly.purge(place);
    return redraw(place);
  }
  const { classList } = document.documentElement;
  classList.add("printing"); // a picture is as on paper
  const size = { filename: name, width: 900, height: 560, scale: 2 };
  const figure = figureOf(place, size.width);
  classList.toggle("printing", printing);
  for (const trace of figure.data) trace.showscale = Boolean(trace.colorbar);
  Object.assign(figure.layout, {
    title: { text: place.closest(".panel").querySelector("h3")?.innerHTML, font: { size: 13 } },
    showlegend: true, paper_bgcolor: "white", margin: { ...MARGIN, ...figure.layout.margin, t: 40 },
  });
  return Plotly.downloadImage(figure, { format, ...size });
}

// The numbers of a plot, below their names: its columns, or the traces over a common x.
function rowsOf(place) {
  const figure = JSON.parse(place.figure());
  const traces = figure.data.map(({ y }, n) => [figure.names?.[n], y]);
  const named = figure.x ? [["time", figure.x], ...traces] : Object.entries(figure.columns);
  const columns = named.map(([name, given]) => [name, ...numbers(given)]);
  return columns[0].map((_, row) => columns.map((column) => column[row]));
}

function csv(rows) {
  const cell = (value) => {
    const text = value === null || value === undefined || Number.isNaN(value) ? "" : String(value);
    const formula = /^'*[=+\-@\t\r]/.test(text) && Number.isNaN(Number(text)); // for a spreadsheet
    const safe = formula ? `'${text}` : text;
    return /[",\n]/.test(safe) ? `"${safe.replaceAll('"', '""')}"` : safe;
  };
  return rows.map((row) => row.map(cell).join(",") + "\n").join("");
}

function save(name, content) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type: "text/csv" }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
