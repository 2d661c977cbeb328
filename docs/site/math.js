// Typeset each formula: arithmatex writes \( \) around formulas in a line and \[ \] around displayed ones.
document.addEventListener("DOMContentLoaded", () => {
  for (const element of document.querySelectorAll(".arithmatex")) {
    const formula = element.textContent.trim();
    katex.render(formula.slice(2, -2), element, {
      displayMode: formula.startsWith("\\["),
      throwOnError: false,
    });
    element.append("\u2060"); // a full stop stays on the line of its formula
  }
});
