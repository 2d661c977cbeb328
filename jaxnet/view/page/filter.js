// Which cells are shown everywhere on the page: of each swept key all values or one.
const keys = Object.keys(data.keys);
const choice = keys.map(() => -1); // the place of a value, -1 for all
const followers = []; // what shows other cells when the choice changes
const widths = []; // what is laid out anew when the page's width changes

const chosen = (cell) => choice.every((place, key) => place < 0 || data.cells[cell][key] === place);
const anyChosen = (cells) => cells.some(chosen);

function toldChoice() {
  const values = choice.flatMap((place, key) => (place < 0 ? [] : [data.keys[keys[key]][place]]));
  const count = data.cells.filter((_, cell) => chosen(cell)).length;
  if (!values.length) return `Cells shown: all ${count}`;
  return `Cells shown: ${count} of ${data.cells.length} (${values.join(", ")})`;
}

// The choice stands in the address, so that it can be kept and sent.
function readAddress() {
  const given = new URLSearchParams(location.hash.slice(1));
  keys.forEach((key, number) => { choice[number] = data.keys[key].indexOf(given.get(key)); });
}
function writeAddress() {
  const given = new URLSearchParams();
  keys.forEach((key, number) => { if (choice[number] >= 0) given.set(key, data.keys[key][choice[number]]); });
  history.replaceState(null, "", `#${given}`);
}

function showFilter() {
  const several = keys.map((key, number) => [key, number]).filter(([key]) => data.keys[key].length > 1);
  if (!several.length) return;
  readAddress();
  const told = element("summary");
  const selects = several.map(([key, number]) => {
    const options = ["all", ...data.keys[key]].map((text, place) => element("option", { value: place - 1 }, text));
    return element("select", { change: (event) => { choice[number] = +event.target.value; follow(); } }, ...options);
  });
  const all = element("button", { type: "button", click: () => { choice.fill(-1); follow(); } }, "All cells");
  const say = () => {
    told.textContent = toldChoice();
    several.forEach(([, number], place) => { selects[place].value = choice[number]; });
  };
  const follow = () => { writeAddress(); say(); followers.forEach((each) => each()); };
  const labels = several.map(([, number], place) => element("label", {}, `${data.names[number]} `, selects[place]));
  document.querySelector("main").prepend(
    element("details", { class: "filter" }, told, element("div", { class: "controls" }, ...labels, all)));
  addEventListener("hashchange", () => { if (location.hash.includes("=")) readAddress(), follow(); });
  say();
}
showFilter();
