// Tiles over two swept keys: tables on one scale of colours, beside each other as there is room.
const HEAT = { head: 11, tight: 2.7, roomy: 4.7, widest: 6, few: 400 }; // [em], and tiles that have intervals

const breakable = (name) => name.replace(/[._(=]/g, "$&\u200b");

function showHeat(section, given) {
  const place = section.querySelector(".drawn"), tables = element("div", { class: "heat" });
  const scale = element("div", { class: "scale" }), told = element("output", { class: "told" });
  const titles = [...new Set(given.panels.map((panel) => panel.title))];
  let metric = given.metrics[0];

  function fill(tile, cell) {
    const value = metric.places[cell], star = cell in given.failed ? "*" : "";
    tile.dataset.cell = cell;
    if (value === null || value === undefined) {
      tile.classList.add("blank");
      tile.append(star || "–");
      return tile;
    }
    const [ground, ink] = given.palette[Math.round(value * (given.palette.length - 1))];
    Object.assign(tile.style, { background: ground, color: ink });
    tile.append(metric.words[cell] + star, metric.share ? element("small", {}, given.intervals[cell]) : "");
    return tile;
  }

  function words(cell) {
    if (cell < 0) return "Not run.";
    const where = keys.map((key, number) => data.keys[key][data.cells[cell][number]]).join(", ");
    const of = `${given.ok[cell].toLocaleString("en")} lane${given.ok[cell] === 1 ? "" : "s"}`, value = metric.values[cell];
    const interval = `, ${short(given.confidence)} % interval ${short(given.low[cell])} to ${short(given.high[cell])} %`;
    const what = value === null ? given.blank[cell] : metric.share ? `${short(value)} % ${given.share}${interval}, of ${of}`
      : `${metric.told} ${measured(value)} ${metric.unit}, of ${of}`;
    return `${where} (cell ${cell}): ${what}; ${given.failed[cell] ? `failed: ${given.failed[cell]}` : "none failed"}.`;
  }

  function table(group, rows, columns) {
    const [row, names] = given.rows, [column, values] = given.columns;
    const corner = element("th", { scope: "col" }, `${breakable(row)} ↓`, element("br"), `${breakable(column)} →`);
    const across = group.map((panel) => element("th", { scope: "colgroup", colspan: columns.length }, breakable(panel.across)));
    const first = (n) => (n % columns.length || !n ? "" : "first"); // of a panel after another
    const heads = group.flatMap(() => columns).map((n, at) => element("th", { scope: "col", class: first(at) }, breakable(values[n])));
    const body = rows.map((n) => {
      const cells = group.flatMap((panel) => columns.map((place) => panel.cells[n][place]));
      const tiles = cells.map((cell, at) => fill(element("td", { tabindex: -1, class: first(at) }), cell));
      return element("tr", { "data-cells": cells.filter((cell) => cell >= 0).join(" ") }, element("th", { scope: "row" }, breakable(names[n])), ...tiles);
    });
    body[0].cells[1].tabIndex = 0;
    const top = group[0].across ? [element("tr", {}, element("td"), ...across)] : [];
    return element("table", {}, element("thead", {}, ...top, element("tr", {}, corner, ...heads)), element("tbody", {}, ...body));
  }

  function show() {
    const shown = (cells) => cells.some((cell) => cell >= 0 && chosen(cell));
    const there = given.panels.filter((panel) => shown(panel.cells.flat())).map((panel) => panel.cells);
    const rows = given.rows[1].map((_, n) => n).filter((n) => shown(there.flatMap((cells) => cells[n])));
    const columns = given.columns[1].map((_, n) => n).filter((n) => shown(there.flatMap((cells) => cells.map((row) => row[n]))));
    const room = place.clientWidth / parseFloat(getComputedStyle(tables).fontSize) - HEAT.head - 1;
    const intervals = metric.share && there.length * rows.length * columns.length <= HEAT.few && room >= HEAT.roomy * columns.length;
    const most = Math.max(1, Math.floor(room / (columns.length * (intervals ? HEAT.roomy : HEAT.tight))));
    tables.classList.toggle("intervals", intervals);
    let least = HEAT.widest;
    tables.replaceChildren(...titles.flatMap((title) => {
      const group = given.panels.filter((panel) => panel.title === title && shown(panel.cells.flat())), number = Math.ceil(group.length / most);
      const size = Math.ceil(group.length / number);
      least = Math.min(least, room / (columns.length * Math.min(most, Math.max(size, 1))));
      return Array.from({ length: group.length ? number : 0 }, (_, n) => element("div", { class: "box" },
        ...(title ? [element("h3", {}, title)] : []), table(group.slice(n * size, (n + 1) * size), rows, columns)));
    }));
    tables.style.setProperty("--tile", `${least}em`);
    told.textContent = there.length ? "" : "There is nothing to draw of these cells.";
  }

  function places() {
    const [low, high] = metric.ends;
    if (metric.share) return [0, 25, 50, 75, 100].map((share) => [share / 100, share]);
    const decades = Math.round(Math.log10(high / low)), step = Math.ceil(decades / 5);
    return Array.from({ length: Math.floor(decades / step) + 1 }, (_, n) => [n * step / decades, short(low * 10 ** (n * step))]);
  }

  function showScale() {
    const colours = given.palette.map(([ground]) => ground);
    const ticks = places().map(([at, text]) => element("span", { style: `left: ${100 * at}%` }, text));
    const bar = element("div", { class: "bar", style: `background: linear-gradient(to right, ${colours})` });
    const reasons = [...new Set(given.panels.flatMap((panel) => panel.cells.flat()).filter((cell) => cell < 0 || metric.places[cell] === null)
      .map((cell) => (cell < 0 ? "not run" : given.blank[cell])))];
    const hatched = reasons.length ? [element("span", { class: "blank" }), reasons.join(", ")] : [];
    scale.replaceChildren(element("div", {}, metric.name), element("div", {}, bar, element("div", { class: "ticks" }, ...ticks)), element("div", {}, ...hatched));
  }

  const say = ({ target }) => { const tile = target.closest("[data-cell]"); if (tile) told.textContent = words(+tile.dataset.cell); };
  for (const event of ["pointerover", "focusin", "click"]) tables.addEventListener(event, say);
  tables.addEventListener("keydown", (event) => {
    const tile = event.target.closest("[data-cell]"), step = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[event.key];
    if (!tile || !step) return;
    event.preventDefault();
    const next = tile.closest("tbody").rows[tile.parentElement.sectionRowIndex + step[0]]?.cells[tile.cellIndex + step[1]];
    if (next?.dataset.cell) tile.tabIndex = -1, next.tabIndex = 0, next.focus();
  });
  if (given.metrics.length > 1) {
    const options = given.metrics.map(({ name }, n) => element("option", { value: n }, name));
    const select = element("select", { change: (event) => { metric = given.metrics[event.target.value]; showScale(); show(); } }, ...options);
    place.append(element("div", { class: "controls" }, element("label", {}, "Show the ", select)));
  }
  place.append(scale, tables, told);
  followers.push(show);
  widths.push(show);
  showScale();
  show();
}
if (data.sections.heat) showHeat(document.getElementById("heat"), data.sections.heat);
