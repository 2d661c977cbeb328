// One lane in motion: the plane, the errors and whom vehicles retain, at one time.
const STEP = 80; // [ms] from frame to frame
const MOST_CURVED = 150; // frames between which paths are curves
const LANE_KEY = [
  { name: "navigator", look: { line: { color: "--black", dash: "2 3" }, marker: { symbol: "square-open", color: "--black" } } },
  { name: "vehicle", look: { line: { color: "--sky" }, marker: { symbol: "circle", color: "--blue" } } },
  { name: "attacked vehicle", look: { line: { color: "--red", dash: "6 2" }, marker: { symbol: "diamond", color: "--red" } } },
  { name: "place that is told", look: { line: { color: "--purple", width: 2 }, marker: { symbol: "diamond-open", color: "--purple" } } },
  { name: "retained link", look: { line: { color: "--muted" } } },
  { name: "dropped link", look: { line: { color: "--muted", dash: "1 4" } } },
];
const FATES = [["dropped", "--line"], ["dropped, attacked", "--green"], ["retained", "--sky"], ["retained, attacked", "--red"]];

// The numbers of a lane, by frame and vehicle (from 1).
function unpacked(given) {
  const { vehicles, attacked } = given, at = (packed) => ((values) => (frame, vehicle) => values[frame * vehicles + vehicle - 1])(floats(packed));
  const centre = ["centre_x", "centre_y"].map((key) => floats(given[key]));
  const signal = floats(given.attack), bits = given.kept && bytes(given.kept), links = given.links.length;
  const lane = {
    ...given, axes: ["x [m]", "y [m]"], trail: Infinity, time: floats(given.time), ahead: at(given.ahead), error: at(given.error), centre,
    all: Array.from({ length: vehicles }, (_, n) => n + 1),
    called: (vehicle) => `vehicle ${vehicle}` + (given.names.length ? ` (${given.names[vehicle - 1].replaceAll("<", "&lt;")})` : ""),
    isAttacked: (vehicle) => attacked.includes(vehicle),
    retained: (frame, link) => !bits || ((bits[(frame * links + link) >> 3] >> (7 - ((frame * links + link) & 7))) & 1) === 1,
  };
  const [x, y] = [at(given.x), at(given.y)];
  // Source 0 is the navigator; without one it is the mean of the vehicles that are not attacked.
  lane.place = (frame, source) => (source ? [x(frame, source), y(frame, source)] : centre.map((each) => each[frame]));
  // Whose place is falsified at an attacked vehicle, its own or what it hears of the navigator's, and what is told instead.
  lane.speaks = (frame, vehicle) => lane.place(frame, given.heard_from_navigator ? 0 : vehicle);
  lane.told = (frame, vehicle) => {
    const alone = given.leaderless ? [0, 0] : lane.place(frame, 0); // what a link carries that is replaced, without the signal
    const from = given.replaced ? alone : lane.speaks(frame, vehicle);
    const n = 2 * (frame * attacked.length + attacked.indexOf(vehicle));
    return [from[0] + signal[n], from[1] + signal[n + 1]];
  };
  const ends = lane.time.reduce((most, _, frame) =>
    Math.max(most, ...lane.all.flatMap((vehicle) => lane.place(frame, vehicle)).concat(lane.place(frame, 0)).map(Math.abs).filter(Number.isFinite)), 1);
  lane.reach = 1.05 * ends;
  return lane;
}

// Points joined by lines, in one trace with gaps.
function segments(pairs) {
  const [x, y] = [[], []];
  for (const path of pairs) {
    for (const point of path) x.push(point[0]), y.push(point[1]);
    x.push(null), y.push(null);
  }
  return { x, y };
}
const points = (places) => ({ x: places.map(([x]) => x), y: places.map(([, y]) => y) });

function trails(lane, frame) {
  const shape = lane.time.length <= MOST_CURVED ? "spline" : "linear";
  const from = Math.max(0, frame - lane.trail);
  const path = (source) => Array.from({ length: frame + 1 - from }, (_, n) => lane.place(from + n, source));
  const trail = (name, vehicles, line) => ({ name, ...segments(vehicles.map(path)), mode: "lines", line: { ...line, shape }, hoverinfo: "skip", showlegend: false });
  const [honest, attacked] = [lane.all.filter((each) => !lane.isAttacked(each)), lane.attacked];
  return [
    ...(lane.leaderless ? [] : [{ name: "navigator", x: lane.centre[0], y: lane.centre[1], mode: "lines", hoverinfo: "skip", showlegend: false,
      line: { color: "--black", width: 1.5, dash: "2px,3px", shape } }]),
    trail("vehicle", honest, { color: "--sky", width: 1.2 }),
    trail("attacked vehicle", attacked, { color: "--red", width: 1.4, dash: "6px,2px" }),
  ];
}

function linksNow(lane, frame) {
  const lines = (name, retained, line) => ({
    name, mode: "lines", line, hoverinfo: "skip",
    ...segments(lane.links.filter((_, n) => lane.retained(frame, n) === retained)
      .map(([listener, source]) => [lane.place(frame, source), lane.place(frame, listener)])),
  });
  return [
    lines("dropped link", false, { color: "--muted", width: 1, dash: "1px,4px" }),
    lines("retained link", true, { color: "--muted", width: 0.8 }),
  ];
}

function toldNow(lane, frame) {
  const told = lane.attacked.map((vehicle) => lane.told(frame, vehicle));
  const text = lane.attacked.map((vehicle, n) => {
    const whose = lane.heard_from_navigator ? `${lane.called(vehicle)} hears of the navigator` : `${lane.called(vehicle)} tells its neighbours`;
    const true_ = lane.speaks(frame, vehicle);
    return `${whose}: ${short(Math.hypot(told[n][0] - true_[0], told[n][1] - true_[1]))} m from the truth`;
  });
  return [
    { name: "place that is told", mode: "lines", line: { color: "--purple", width: 2 }, hoverinfo: "skip", showlegend: false,
      ...segments(lane.attacked.map((vehicle, n) => [lane.speaks(frame, vehicle), told[n]])) },
    { name: "place that is told", mode: "markers", ...points(told), text, hoverinfo: "text",
      marker: { color: "--purple", symbol: "diamond-open", size: 9, line: { width: 2 } } },
  ];
}

// A marker turns clockwise from up and stands off backwards, directions turn anticlockwise from x. Of a narrow
// diamond, the same either way up, the front half looks out of the vehicle as a triangle.
function fleetNow(lane, frame) {
  const some = (name, vehicles, color, symbol, size, standoff) => {
    const where = points(vehicles.map((vehicle) => lane.place(frame, vehicle)));
    const text = vehicles.map((vehicle) => `${lane.called(vehicle)}: ${lane.leaderless ? "" : "error "}${measured(lane.error(frame, vehicle))} m${lane.leaderless ? " from the mean" : ""}`);
    const angle = vehicles.map((vehicle) => 270 - lane.ahead(frame, vehicle));
    return [
      { name, ...where, mode: "markers", text, hoverinfo: "text", marker: { color, symbol, size } },
      { name, ...where, mode: "markers", hoverinfo: "skip", showlegend: false, marker: { color, symbol: "diamond-tall", size: 11, standoff, angle } },
    ];
  };
  const honest = lane.all.filter((each) => !lane.isAttacked(each));
  return [
    ...some("vehicle", honest, "--blue", "circle", 8, 6),
    ...some("attacked vehicle", lane.attacked, "--red", "diamond", 10, 7),
    ...(lane.leaderless ? [] : [{ name: "navigator", ...points([lane.place(frame, 0)]), mode: "markers", text: ["navigator"], hoverinfo: "text",
      marker: { color: "--black", symbol: "square-open", size: 13, line: { width: 2 } } }]),
  ];
}

// The lane as the navigator sees it, or the mean without one: places relative to it, as far as errors reach in the second half.
function aroundCentre(lane) {
  const relative = (place) => (frame, source) => {
    const [here, origin] = [place(frame, source), lane.place(frame, 0)];
    return here.map((value, n) => value - origin[n]);
  };
  const told = relative(lane.told), late = Array.from(lane.time.keys()).filter((frame) => 2 * frame >= lane.time.length - 1);
  const far = late.flatMap((frame) => [...lane.all.map((vehicle) => lane.error(frame, vehicle)),
    ...lane.attacked.map((vehicle) => Math.hypot(...told(frame, vehicle)))]).filter(Number.isFinite);
  const centre = lane.centre.map((each) => each.map(() => 0)), axes = ["x", "y"].map((axis) => `${axis} − ${centreName(lane, axis)} [m]`);
  return { ...lane, place: relative(lane.place), speaks: relative(lane.speaks), told, centre,
    trail: Math.ceil(lane.time.length / 4), axes, reach: far.reduce((most, each) => Math.max(most, 1.15 * each), 1e-3) };
}

// A coordinate of the navigator, or of the mean without one.
const centreName = (lane, axis) => (lane.leaderless ? `${axis}\u0304` : `${axis}<sub>0</sub>`);

// The frame of the last quarter at which a vehicle is farthest off.
function worstFrame(lane) {
  const off = (frame) => Math.max(...lane.all.map((vehicle) => lane.error(frame, vehicle) || 0));
  const late = Array.from(lane.time.keys()).slice(Math.floor(0.75 * lane.time.length));
  return late.reduce((worst, frame) => (off(frame) > off(worst) ? frame : worst));
}

function positions(lane, frame) {
  const range = [-lane.reach, lane.reach];
  return {
    data: [...linksNow(lane, frame), ...trails(lane, frame), ...toldNow(lane, frame), ...fleetNow(lane, frame)],
    layout: {
      xaxis: { range, title: { text: lane.axes[0] }, constrain: "domain" },
      yaxis: { range: [...range], title: { text: lane.axes[1] }, scaleanchor: "x", constrain: "domain" },
      margin: { l: 62, r: 12, t: 6, b: 48 }, uirevision: lane.label + lane.axes,
    },
  };
}

const cursor = (time) => [{ type: "line", x0: time, x1: time, y0: 0, y1: 1, yref: "paper", line: { color: "--text", width: 1, dash: "dot" } }];
const timeAxis = (lane) => ({ range: [0, lane.time.at(-1)], title: { text: "t [s]" } });

function errors(lane, frame) {
  const one = (vehicle) => {
    const attacked = lane.isAttacked(vehicle), values = Array.from(lane.time, (_, n) => lane.error(n, vehicle));
    return { name: attacked ? "attacked vehicle" : "vehicle", x: lane.time, y: values.map((value) => Math.max(ROUNDING, value)), mode: "lines",
      text: values.map((value) => `${lane.called(vehicle)}${attacked ? " (attacked)" : ""}: ${measured(value)} m`), hoverinfo: "text",
      line: { color: attacked ? "--red" : "--sky", width: attacked ? 1.6 : 1.2, dash: attacked ? "6px,2px" : "solid" } };
  };
  const all = lane.all.flatMap((vehicle) => Array.from(lane.time, (_, n) => lane.error(n, vehicle))).filter((value) => value > ROUNDING);
  const [least, most] = all.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, ROUNDING]);
  const ends = [10 ** Math.floor(Math.log10(Math.min(least, most))), 10 ** Math.ceil(Math.log10(most) + 0.01)];
  return { data: lane.all.map(one), layout: { xaxis: timeAxis(lane), yaxis: decades(ends, `‖y<sub>i</sub> − ${centreName(lane, "y")}‖ [m]`), shapes: cursor(lane.time[frame]) } };
}

function raster(lane, frame) {
  const fate = (n, link) => 2 * lane.retained(n, link) + lane.links[link][2];
  const z = lane.links.map((_, link) => Array.from(lane.time, (_, n) => fate(n, link)));
  const name = ([listener, source, attacked]) => `${listener} ← ${source}${attacked ? " ⚠" : ""}`;
  const text = lane.links.map(([listener, source], link) => Array.from(lane.time, (time, n) =>
    `${lane.called(listener)} hears ${source ? lane.called(source) : "the navigator"}, t = ${short(time)} s: ${FATES[fate(n, link)][0]}`));
  const colorscale = FATES.flatMap(([, color], n) => [[n / 4, coloured(color)], [(n + 1) / 4, coloured(color)]]);
  const places = lane.links.map((_, n) => n), every = Math.ceil(places.length / 40);
  const ticks = places.filter((n) => n % every === 0);
  return {
    data: [{ type: "heatmap", x: lane.time, y: places, z, text, hoverinfo: "text", colorscale, zmin: -0.5, zmax: 3.5, showscale: false }],
    layout: { xaxis: { ...timeAxis(lane), showgrid: false }, shapes: cursor(lane.time[frame]),
      yaxis: { range: [places.length - 0.5, -0.5], tickvals: ticks, ticktext: ticks.map((n) => name(lane.links[n])), showgrid: false,
        tickfont: { size: 9 }, title: { text: "listener ← source" } } },
  };
}

// What is saved: paths with what is told, errors, and whom vehicles retain.
const LANE_ROWS = {
  positions: (lane) => [["time", "vehicle", "x", "y", "told_x", "told_y"], ...Array.from(lane.time).flatMap((time, n) => (lane.leaderless ? lane.all : [0, ...lane.all]).map((source) =>
    [time, source, ...lane.place(n, source), ...(lane.isAttacked(source) && !lane.heard_from_navigator ? lane.told(n, source) : [null, null])]))],
  errors: (lane) => [["time", ...lane.all.map((vehicle) => `vehicle ${vehicle}`)],
    ...Array.from(lane.time, (time, n) => [time, ...lane.all.map((vehicle) => lane.error(n, vehicle))])],
  raster: (lane) => [["time", "listener", "source", "attacked", "retained"], ...Array.from(lane.time).flatMap((time, n) => lane.links.map(([i, j, attacked], link) =>
    [time, i, j, +attacked, +lane.retained(n, link)]))],
};

function showLanes(section, lanes) {
  let lane, seen, timer;
  const hidden = new Set(), select = element("select", { class: "lane" }), command = element("code"), said = element("p"), again = element("p", {}, "This lane again: ", command);
  const slider = element("input", { type: "range", min: 0, value: 0, step: 1, "aria-label": "time" });
  const play = element("button", { type: "button" }, "Play"), clock = element("output");
  const frame = () => +slider.value;
  const panel = (title, figure, rows, classes) => plotOf(title, () => {
    const { data, layout: given } = figure(lane, frame());
    return { data: visible(data, hidden), layout: layout(given) };
  }, () => rows(lane), classes);
  const around = element("select", { class: "view", change: () => look() },
    element("option", { value: "centre" }), element("option", { value: "plane" }, "in the plane"));
  const inPlane = panel("Positions", (_, now) => positions(seen, now), LANE_ROWS.positions, "plane");
  const named = lanes.every((each) => each.leaderless) ? "Distance of each vehicle from the mean of those not attacked" : "Error of each vehicle";
  const overTime = [panel(named, errors, LANE_ROWS.errors, "errors"), panel("Whom vehicles retain", raster, LANE_ROWS.raster, "raster")];
  const [plot, ...cursors] = [inPlane, ...overTime].map((each) => each.querySelector(".plot"));
  const show = () => {
    redraw(plot);
    for (const each of cursors)
      if (each.stale || !each.layout) redraw(each);
      else Plotly.relayout(each, { "shapes[0].x0": lane.time[frame()], "shapes[0].x1": lane.time[frame()] });
    clock.textContent = `t = ${lane.time[frame()].toFixed(2)} s`;
    slider.setAttribute("aria-valuetext", clock.textContent);
  };
  const look = () => {
    seen = around.value === "plane" ? lane : aroundCentre(lane);
    show();
  };
  const stop = () => { clearInterval(timer); timer = undefined; play.textContent = "Play"; };
  const go = (place) => { slider.value = place; show(); };
  const toggle = () => {
    if (timer) return stop();
    if (slider.value === slider.max) slider.value = 0;
    play.textContent = "Pause";
    timer = setInterval(() => { go(frame() + 1); if (slider.value === slider.max) stop(); }, STEP);
  };
  const choose = () => {
    stop();
    lane = unpacked(lanes[+select.value]);
    slider.max = lane.time.length - 1;
    command.textContent = lane.command;
    said.textContent = wordsOf(lane);
    overTime[1].hidden = keys.children[5].hidden = !lane.kept;
    keys.children[0].hidden = lane.leaderless;
    around.options[0].textContent = `around the ${lane.leaderless ? "mean of vehicles not attacked" : "navigator"}`;
    keys.children[2].hidden = keys.children[3].hidden = !lane.attacked.length;
    cursors.forEach((each) => { each.stale = true; });
    slider.value = worstFrame(lane);
    look();
  };
  const offer = () => {
    const options = lanes.flatMap((given, value) => (anyChosen(given.cells) ? [element("option", { value }, given.label)] : []));
    select.replaceChildren(...options);
    stage.hidden = !options.length;
    none.hidden = !!options.length;
    if (options.length) choose();
  };
  const keyboard = (event) => {
    if (event.target !== stage) return;
    const by = { ArrowRight: 1, ArrowLeft: -1, Home: -Infinity, End: Infinity }[event.key];
    if (event.key === " ") toggle();
    else if (by) stop(), go(Math.max(0, Math.min(+slider.max, frame() + by)));
    else return;
    event.preventDefault();
  };
  for (const each of cursors) // the plot listens once it is drawn
    each.addEventListener("click", () => {
      const at = each._hoverdata?.[0]?.x;
      if (at !== undefined) stop(), go(lane.time.reduce((best, time, n) => (Math.abs(time - at) < Math.abs(lane.time[best] - at) ? n : best), 0));
    });
  play.addEventListener("click", toggle);
  slider.addEventListener("input", () => { stop(); show(); });
  select.addEventListener("change", choose);
  const keys = keyOf(LANE_KEY, hidden, () => [plot, ...cursors].forEach(redraw));
  const fates = element("ul", { class: "key" }, ...FATES.map(([name, color]) => element("li", {}, swatch({ area: color }), name)));
  overTime[1].append(fates);
  const none = element("p", {}, "No lane of these cells is on the page; the commands above bring one.");
  const stage = element("div", { class: "stage", tabindex: 0, role: "group", "aria-label": "Lane: arrow keys step, space plays", keydown: keyboard },
    element("div", { class: "controls" }, element("label", {}, "Lane ", select),
      element("label", {}, "Show positions ", around)), keys,
    element("div", { class: "controls" }, play, slider, clock),
    element("div", { class: "views" }, inPlane, element("div", {}, ...overTime)), said, again);
  section.querySelector(".drawn").append(none, stage);
  followers.push(offer);
  offer();
}

function wordsOf(lane) {
  const step = short(lane.time[1] - lane.time[0]), kept = lane.kept ? "" : " Nobody trims here: every source is retained at all times.";
  const thinned = lane.time.length < lane.outputs ? `, some of ${lane.outputs} output times` : "";
  return `${lane.label}. Shown every ${step} s${thinned}; a path is a smooth curve through its places.` +
    ` A triangle points where a vehicle heads.${kept}`;
}
if (data.sections.lanes) showLanes(document.getElementById("lanes"), data.sections.lanes);
