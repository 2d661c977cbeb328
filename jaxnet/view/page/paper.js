// The light may change, and on paper it is light and plots are as wide as a sheet: drawn before it is laid out.
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => plots.forEach(redraw));

function layOut(printing) {
  document.documentElement.classList.toggle("printing", printing);
  widths.forEach((each) => each());
  for (const table of document.querySelectorAll("table")) {
    table.style.fontSize = "";
    const wide = table.scrollWidth / table.parentElement.clientWidth;
    if (printing && wide > 1) table.style.fontSize = `${0.98 / wide}em`;
  }
  for (const plot of plots) {
    plot.stale = true;
    draw(plot, printing);
    if (plot.layout && plot.clientWidth)
      Plotly.relayout(plot, printing ? { width: plot.clientWidth, height: plot.clientHeight } : { width: null, height: null, autosize: true });
  }
}
addEventListener("resize", () => widths.forEach((each) => each()));
addEventListener("beforeprint", () => layOut(true));
addEventListener("afterprint", () => layOut(false));
