// Tables show the rows of the cells chosen.
function filterTables() {
  for (const table of document.querySelectorAll("table")) {
    const rows = [...table.tBodies[0].rows];
    for (const row of rows) row.hidden = !anyChosen(row.dataset.cells.split(" ").map(Number));
    table.caption?.remove();
    if (rows.every((row) => row.hidden)) table.createCaption().textContent = "No row is about these cells.";
  }
}
followers.push(filterTables);
filterTables();
