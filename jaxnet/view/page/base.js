"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const ROUNDING = 1e-9; // of ā, or of a metre: what is below is arithmetic

// An element with attributes, properties that are functions as listeners, and children.
function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes))
    if (typeof value === "function") made.addEventListener(name, value);
    else made.setAttribute(name, value);
  made.append(...children);
  return made;
}

// Numbers as plotly packs them: base64 of single precision.
function bytes(packed) {
  return Uint8Array.from(atob(packed), (letter) => letter.charCodeAt(0));
}
const floats = (packed) => new Float32Array(bytes(packed).buffer);

// Three digits, as one reads them aloud.
function short(value) {
  if (value === null || Number.isNaN(value)) return "–";
  const rounded = +value.toPrecision(3), size = Math.abs(rounded);
  return size && (size < 1e-3 || size >= 1e5) ? rounded.toExponential() : String(rounded);
}

// An error [m] where the attack is so large, or not there.
function measured(value, size = 1) {
  const rounding = value !== null && value !== 0 && Math.abs(value) < ROUNDING * (size || 1);
  return rounding ? "0 (rounding)" : short(value);
}

function csv(rows) {
  const cell = (value) => {
    const given = value === null || value === undefined || Number.isNaN(value) ? "" : String(value);
    const text = /^'*[=+\-@\t\r]/.test(given) && Number.isNaN(Number(given)) ? `'${given}` : given; // no formula
    return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  return rows.map((row) => row.map(cell).join(",") + "\n").join("");
}

function save(name, content) {
  const address = URL.createObjectURL(new Blob([content], { type: "text/csv" }));
  element("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 1000);
}

const escaped = (text) => element("i", {}, text).innerHTML; // plotly reads a little HTML
