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
for (const head of document.querySelectorAll("th[aria-sort]"))
  head.querySelector("button").addEventListener("click", () => sortBy(head));

