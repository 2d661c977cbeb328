// Typeset each formula: arithmatex writes \( \) around formulas in a line and \[ \] around displayed ones.
document.addEventListener("DOMContentLoaded", () => {
  for (const element of document.querySelectorAll(".arithmatex")) {
    const written = element.textContent.trim();
    const displayMode = written.startsWith("\\[");
    katex.render(written.slice(2, -2), element, { displayMode, throwOnError: false });
    if (!displayMode) keepTogether(element, written);
  }
});

// A full stop stays on the line of its formula, and a short formula stays on one line.
function keepTogether(element, written) {
  const text = element.nextSibling;
  const [mark] = /^[.,:;)]*/.exec(text?.nodeType === Node.TEXT_NODE ? text.data : "");
  if (mark) {
    text.deleteData(0, mark.length);
    element.append(mark);
  }
  if (written.length < 30) element.style.whiteSpace = "nowrap";
}
