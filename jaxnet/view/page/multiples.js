// Small multiples: a panel a group of cells, page by page, all on the same axes.
const PAGE = 24; // panels, or rows of one plot

const MEDIAN = { marker: { symbol: "circle", color: "--black" } };
const MAXIMUM = { marker: { symbol: "line-ew", color: "--black" } };
const MEAN = { marker: { symbol: "diamond-open", color: "--muted" } };
const BELOW = { marker: { symbol: "triangle-down", color: "--black" } };

function bars(middle, low, high, color, width = 0) {
  const above = high.map((value, n) => (value ?? middle[n]) - middle[n]), below = low.map((value, n) => middle[n] - (value ?? middle[n]));
  return { symmetric: false, array: above, arrayminus: below, color, thickness: 1.3, width };
}

function sizesAxis(panels) {
  const sizes = panels.flatMap((panel) => panel.size);
  return roomyLogAxis(Math.min(...sizes), Math.max(...sizes), "attack magnitude ā [m]");
}

// δ̂(ā): what lies below the axis stands on it.
const ultimate = {
  choices: (given) => Object.entries(given.metrics).map(([metric, words]) => [`${words} (${metric})`, metric]),
  curves: (given) => [
    { name: "median, 5 to 95 %", look: MEDIAN }, { name: "maximum", look: MAXIMUM },
    { name: "mean, 95 % interval", look: MEAN }, { name: "median below the axis", look: BELOW },
    ...Object.entries(given.looks).map(([name, line]) => ({ name, look: { line } })),
  ],
  figure(given, [panel], metric) {
    const [floor] = given.ends[metric], words = metric === "tail_max" ? "greatest tail error [m]" : "mean tail error [m]";
    const lines = Object.entries(panel.lines[metric]).map(([name, slope]) => ({
      name, x: panel.size, y: panel.size.map((size) => slope * size), mode: "lines",
      line: { width: 1.6, ...given.looks[name] }, text: `${name}: ${short(slope)} ā`, hoverinfo: "text",
    }));
    const there = panel.size.map((_, n) => n).filter((n) => panel[metric].median[n] !== null);
    return {
      data: [...lines, ...pointsOf(panel, metric, floor, there)],
      layout: { xaxis: sizesAxis(given.panels), yaxis: decades(given.ends[metric], words) },
    };
  },
  rows(given, [panel], metric) {
    const statistics = Object.keys(panel[metric]), lines = Object.entries(panel.lines[metric]);
    const header = ["attack.magnitude", ...statistics.map((name) => `${metric}_${name}`), ...lines.map(([name]) => name)];
    return [header, ...panel.size.map((size, n) =>
      [size, ...statistics.map((name) => panel[metric][name][n]), ...lines.map(([, slope]) => slope * size)])];
  },
};

function pointsOf(panel, metric, floor, there) {
  const raw = (name) => there.map((n) => panel[metric][name][n]);
  const above = (name) => raw(name).map((value) => (value === null ? null : Math.max(floor, value)));
  const sizes = there.map((n) => panel.size[n]), below = raw("median").map((value) => value <= floor);
  const text = there.map((n) => {
    const size = panel.size[n], told = (name) => measured(panel[metric][name][n], size);
    return `ā = ${short(size)} m<br>median ${told("median")} m<br>5 to 95 %: ${told("q05")} to ${told("q95")} m<br>` +
      `maximum ${told("max")} m<br>mean ${told("mean")} m${panel[metric].low[n] === null ? "" : ` (${told("low")} to ${
        panel[metric].high[n] === null ? "?" : told("high")})`}`;
  });
  const common = { mode: "markers", text, hoverinfo: "text" };
  const median = (name, wanted, symbol) => {
    const some = (values) => values.filter((_, n) => below[n] === wanted);
    return { ...common, name, x: some(sizes), y: some(above("median")), text: some(text), cliponaxis: false,
      marker: { symbol, size: 6, color: "--black" },
      error_y: bars(some(above("median")), some(above("q05")), some(above("q95")), "--black") };
  };
  return [
    { ...common, name: "mean, 95 % interval", x: sizes.map((size) => size * 1.1), y: above("mean"),
      marker: { symbol: "diamond-open", size: 6, color: "--muted" },
      error_y: bars(above("mean"), above("low"), above("high"), "--muted") },
    median("median, 5 to 95 %", false, "circle"), median("median below the axis", true, "triangle-down"),
    { ...common, name: "maximum", x: sizes, y: above("max"),
      marker: { symbol: "line-ew-open", size: 8, color: "--black", line: { width: 1.6, color: "--black" } } },
  ];
}

// ẽ(t), or the spread over time: 5 to 95 % filled, median and maximum as lines.
const MEDIAN_LINE = { color: "--blue", width: 2, dash: "solid" }, MAXIMUM_LINE = { color: "--red", width: 1.4, dash: "5px,3px" };
const bands = {
  curves: (given) => [
    ...(given.panels.some(({ lanes }) => lanes > 1) ? [
      { name: "median of lanes", look: { line: MEDIAN_LINE } }, { name: "5 to 95 %", look: { area: "--band" } },
      { name: "maximum", look: { line: MAXIMUM_LINE } }] : []),
    ...(given.panels.some(({ lanes }) => lanes === 1) ? [{ name: "one lane", look: { line: MEDIAN_LINE } }] : []),
  ],
  figure(given, [panel]) {
    const time = floats(given.time);
    const drawn = (name) => floats(panel[name]).map((value) => Math.max(ROUNDING, value));
    const curve = (name, key, line) => {
      const text = [...floats(panel[key])].map((value, n) => `${name} ${measured(value)} m at ${short(time[n])} s`);
      return { name, x: time, y: drawn(key), mode: "lines", line, text, hoverinfo: "text" };
    };
    const edge = { name: "5 to 95 %", x: time, mode: "lines", line: { width: 0, color: "--blue" }, hoverinfo: "skip" };
    return {
      data: panel.lanes === 1 ? [curve("one lane", "median", MEDIAN_LINE)] : [
        { ...edge, y: drawn("low"), showlegend: false }, { ...edge, y: drawn("high"), fill: "tonexty", fillcolor: "--band" },
        curve("maximum", "greatest", MAXIMUM_LINE), curve("median of lanes", "median", MEDIAN_LINE),
      ],
      layout: { xaxis: { range: [0, time.at(-1)], title: { text: "t [s]" } }, yaxis: decades(given.ends, given.label) },
    };
  },
  rows(given, [panel]) {
    const columns = [given.time, panel.low, panel.median, panel.high, panel.greatest].map(floats);
    return [["time", "q05", "median", "q95", "max"], ...Array.from(columns[0], (_, n) => columns.map((column) => column[n]))];
  },
};

// A quantity of cells against a swept key; what is no number has a row of its own.
const SYMBOLS = ["circle", "square", "triangle-up", "diamond", "triangle-down", "cross", "x", "star"];
const DASHES = ["solid", "6px,2px", "2px,2px", "5px,2px,1px,2px", "9px,3px", "4px,2px,1px,2px,1px,2px"];
const lookOf = ({ color, place }) => ({
  line: { color, width: 1.6, dash: DASHES[place % DASHES.length] }, marker: { color, size: 6, symbol: SYMBOLS[place % SYMBOLS.length] },
});
const ALONE = 340; // [px], height of the only panel
const curve = {
  curves: (given) => (given.hue === null ? [] : given.looks.map((each) => ({ name: each.name, look: lookOf(each) }))),
  title: (given) => given.hue,
  height: (given) => (given.x.names ? 34 + 36 * wrapped(given.y.label).split("<br>").length + Math.max(26, 13 * given.looks.length) * given.x.names.length
    : given.panels.length === 1 && ALONE),
  figure(given, [panel]) {
    const rows = given.x.names !== null, unit = given.y.share ? " %" : "";
    const cut = (value) => (value !== null && given.y.log ? Math.max(given.y.ends[0], value) : value);
    const data = given.looks.map((look, number) => {
      const { x, value, low, high, cells } = panel.series[number];
      const shown = x.map((_, n) => n).filter((n) => chosen(cells[n]));
      const some = (values) => shown.map((n) => values[n]), middle = some(value).map(cut);
      const error = bars(middle, some(low).map(cut), some(high).map(cut), look.color, 3);
      const text = shown.map((n) => {
        const ends = low[n] === null && high[n] === null ? "" : ` (${short(low[n])} to ${short(high[n])}${unit})`;
        return `${[look.name, rows ? given.x.names[x[n]] : `${given.x.label}: ${short(x[n])}`].filter(Boolean).map(escaped).join("<br>")}` +
          `<br>${short(value[n])}${unit}${ends}`;
      });
      const shift = rows ? 0.7 * ((number + 0.5) / given.looks.length - 0.5) : 0, places = some(x).map((place) => place + shift);
      const common = { name: look.name, ...lookOf(look), text, hoverinfo: "text", cliponaxis: false };
      return rows ? { ...common, x: middle, y: places, error_x: error, mode: "markers" }
        : { ...common, x: places, y: middle, error_y: error, mode: "lines+markers" };
    });
    const title = { text: wrapped(given.y.label) }, [first, last] = given.y.ends, room = 0.04 * (last - first);
    const values = given.y.log ? decades(given.y.ends, title.text) : { range: [first - room, last + room], title };
    if (!rows) return { data, layout: { xaxis: numbersAxis(given), yaxis: values } };
    return { data, layout: { xaxis: values, yaxis: { range: [given.x.names.length - 0.5, -0.5],
      tickvals: given.x.names.map((_, n) => n), ticktext: given.x.names.map(wrapped) } } };
  },
  rows(given, [panel]) {
    const header = [given.x.key ?? "all", given.hue ?? "series", given.y.name, "low", "high", "cell"];
    return [header, ...given.looks.flatMap((look, number) => {
      const { x, value, low, high, cells } = panel.series[number];
      return x.map((place, n) => [given.x.names ? given.x.names[place] : place, look.name, value[n], low[n], high[n], cells[n]]);
    })];
  },
};

// The axis of the numbers on x, the same in all panels.
function numbersAxis(given) {
  const all = given.panels.flatMap((panel) => panel.series.flatMap((each) => each.x));
  const least = Math.min(...all), greatest = Math.max(...all), title = { text: escaped(given.x.label) };
  if (!given.x.log) {
    const room = 0.04 * (greatest - least || 1);
    return { range: [least - room, greatest + room], nticks: 6, title };
  }
  return roomyLogAxis(least, greatest, title.text);
}

// The best until then, by lanes: of a search and of random lanes.
const SEARCH_LINE = { color: "--blue", width: 2, dash: "solid", shape: "hv" };
const RANDOM_LINE = { color: "--red", width: 1.6, dash: "5px,3px", shape: "hv" };
const BOUND_LINE = { color: "--black", width: 1.4, dash: "2px,2px" };
const searches = {
  curves: (given) => [
    { name: "search", look: { line: SEARCH_LINE } }, { name: "random lanes", look: { line: RANDOM_LINE } },
    ...(given.panels.some((each) => each.bound !== null) ? [{ name: "bound", look: { line: BOUND_LINE } }] : []),
  ],
  figure(given, [panel]) {
    const lanes = given.panels.flatMap((each) => [...each.lanes, ...each.random_lanes]);
    const heights = given.panels.flatMap((each) => [...each.best, ...each.random_best, each.bound]).filter((value) => value > 0);
    const curve = (name, x, y, line) => {
      const text = y.map((value, n) => `${name} ${short(value)} after ${x[n]} lanes`);
      return { name, x, y, mode: "lines", line, text, hoverinfo: "text" };
    };
    const ends = [Math.min(...lanes), Math.max(...lanes)];
    const bound = panel.bound === null ? [] : [curve("bound", ends, ends.map(() => panel.bound), BOUND_LINE)];
    return {
      data: [...bound, curve("random lanes", panel.random_lanes, panel.random_best, RANDOM_LINE),
        curve("search", panel.lanes, panel.best, SEARCH_LINE)],
      layout: { xaxis: roomyLogAxis(...ends, "lanes"),
        yaxis: roomyLogAxis(Math.min(...heights), Math.max(...heights), given.words) },
    };
  },
  rows(given, [panel]) {
    const column = (name, x, y) => x.map((lanes, n) => [name, lanes, y[n]]);
    return [["what", "lanes", "best"], ...column("search", panel.lanes, panel.best),
      ...column("random lanes", panel.random_lanes, panel.random_best)];
  },
};

// A name on several short lines.
function wrapped(name) {
  const lines = [""];
  for (const word of name.split(" ")) {
    if (lines.at(-1) && lines.at(-1).length + word.length > 26) lines.push("");
    lines[lines.length - 1] += (lines.at(-1) && " ") + word;
  }
  return lines.map(escaped).join("<br>");
}

// How many stand in a row: those that share the first swept value, if they are few.
function columnsOf(panels) {
  const first = (panel) => data.cells[panel.cells[0]][0];
  const run = panels.filter((panel) => first(panel) === first(panels[0])).length;
  return run >= 2 && run <= 4 && panels.length % run === 0 ? run : Math.min(panels.length, 4);
}

function showMultiples(section, given, kind) {
  const place = section.querySelector(".drawn"), grid = element("div", { class: "grid" }), hidden = new Set();
  const told = element("output"), step = (by) => () => { page += by; show(); };
  const back = element("button", { type: "button", click: step(-1) }, "Previous");
  const next = element("button", { type: "button", click: step(1) }, "Next");
  const pager = element("div", { class: "controls pager" }, told, back, next);
  const choices = kind.choices?.(given) ?? [];
  let page = 0, choice = choices[0]?.[1];
  const redrawAll = () => grid.querySelectorAll(".plot").forEach(redraw);
  const panelOf = (panels, title) => plotOf(title, () => {
    const { data, layout: axes } = kind.figure(given, panels, choice);
    return { data: visible(data, hidden), layout: layout(axes) };
  }, () => kind.rows(given, panels, choice));
  const show = () => {
    const all = given.panels.filter((panel) => anyChosen(panel.cells));
    page = Math.max(0, Math.min(page, Math.ceil(all.length / PAGE) - 1));
    const shown = all.slice(page * PAGE, (page + 1) * PAGE);
    pager.hidden = all.length <= PAGE && shown.length > 0;
    told.textContent = shown.length ? `${page * PAGE + 1} to ${page * PAGE + shown.length} of ${all.length}`
      : "There is nothing to draw of these cells.";
    back.disabled = page === 0;
    next.disabled = (page + 1) * PAGE >= all.length;
    [...grid.children].forEach(forget);
    grid.replaceChildren(...shown.map((panel) => panelOf([panel], panel.title)));
    grid.style.setProperty("--columns", shown.length ? columnsOf(shown) : 1);
    const height = kind.height?.(given);
    if (height) grid.querySelectorAll(".plot").forEach((plot) => { plot.style.height = `${height}px`; });
  };
  const curves = kind.curves(given);
  if (curves.length && kind.title?.(given)) place.append(element("p", { class: "key-title" }, kind.title(given)));
  if (curves.length) place.append(keyOf(curves, hidden, redrawAll));
  if (choices.length) {
    const options = choices.map(([words, value]) => element("option", { value }, words));
    const select = element("select", { change: (event) => { choice = event.target.value; redrawAll(); } }, ...options);
    place.append(element("div", { class: "controls" }, element("label", {}, "Show the ", select)));
  }
  place.append(pager, grid);
  followers.push(() => { page = 0; show(); });
  show();
}
for (const [id, kind] of Object.entries({ answer: curve, ultimate, bands, search: searches }))
  if (data.sections[id]) showMultiples(document.getElementById(id), data.sections[id], kind);
