// What every page does: a choice of cells, views, sorted tables, paper.
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const all = (selector, within = document) => [...within.querySelectorAll(selector)];

// The choice: one value of each swept key, or all. It stands in the address, to be sent.
const selects = all(".filter select");
let shown = []; // whether each cell is chosen; empty on a page without a choice

function choose() {
  const wanted = selects.map(({ selectedIndex }) => selectedIndex - 1); // -1 for all
  const fits = (places) =>
    selects.every(({ dataset }, n) => wanted[n] < 0 || places[dataset.key] === wanted[n]);
  shown = data.cells.map(fits);
  for (const each of all("[data-cells]")) {
    const other = !each.dataset.cells.split(" ").some((cell) => shown[cell] ?? true);
    each.classList.toggle("other", other);
    each.disabled = other; // of an option, where the style of a hidden one is ignored
  }
  const values = selects.map(({ value }) => value).filter(Boolean).join(", ");
  const some = `${shown.filter(Boolean).length} of ${shown.length} (${values})`;
  for (const told of all(".filter summary"))
    told.textContent = `Cells shown: ${values ? some : `all ${shown.length}`}`;
  document.dispatchEvent(new Event("chosen"));
}

function readAddress() {
  const given = new URLSearchParams(location.hash.slice(1));
  for (const select of selects) {
    select.value = given.get(select.name) ?? "";
    if (select.selectedIndex < 0) select.selectedIndex = 0;
  }
}

function writeAddress() {
  const given = selects.filter(({ value }) => value).map(({ name, value }) => [name, value]);
  history.replaceState(null, "", `#${new URLSearchParams(given)}`);
  choose();
}

for (const select of selects) select.addEventListener("change", writeAddress);
for (const button of all(".filter button"))
  button.addEventListener("click", () => {
    for (const select of selects) select.selectedIndex = 0;
    writeAddress();
  });
addEventListener("hashchange", () => {
  if (!location.hash.includes("=")) return; // a link to a section
  readAddress();
  choose();
});

// A section of several views shows one.
for (const select of all("select.views"))
  select.addEventListener("change", () => {
    const views = all(".view", select.closest("section"));
    views.forEach((view, n) => (view.hidden = n !== select.selectedIndex));
    document.dispatchEvent(new Event("views"));
  });

// Tables sort by a click on a header, what is not a number last.
function sortBy(head) {
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
}
for (const head of all("th[aria-sort]"))
  head.querySelector("button").addEventListener("click", () => sortBy(head));

// On paper the page is light, and tables and plots are as wide as a sheet.
let printing = false;
function layOut(paper) {
  printing = paper;
  document.documentElement.classList.toggle("printing", paper);
  for (const table of all("table")) {
    table.style.fontSize = "";
    const wide = table.scrollWidth / table.parentElement.clientWidth;
    if (paper && wide > 1) table.style.fontSize = `${0.98 / wide}em`;
  }
  document.dispatchEvent(new Event("paper"));
}
addEventListener("beforeprint", () => layOut(true));
addEventListener("afterprint", () => layOut(false));
document.addEventListener("DOMContentLoaded", () => {
  readAddress();
  choose();
});
