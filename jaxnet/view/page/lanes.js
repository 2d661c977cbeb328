// One lane in motion: the plane, the errors and whom vehicles retain, at one time.
const STEP = 80; // [ms] from frame to frame
const FATES = ["dropped", "dropped, attacked", "retained", "retained, attacked"];
const range = (from, to) => Array.from({ length: to - from }, (_, n) => from + n);

// The numbers of a lane. Source 0 is the navigator, or the mean of the vehicles not attacked.
function unpacked(given) {
  const { vehicles, attacked } = given, time = numbers(given.errors.x);
  const [x, y, told] = ["x", "y", "told"].map((name) => numbers(given[name]));
  const [ahead, shape, ...flags] = ["ahead", "formation", "saturated", "colliding"]
    .map((name) => given[name] && numbers(given[name]));
  const fates = given.raster && numbers(given.raster.data[0].z);
  return {
    ...given, time, frames: range(0, time.length), all: range(1, vehicles + 1),
    honest: range(1, vehicles + 1).filter((vehicle) => !attacked.includes(vehicle)),
    off: given.errors.data.map((trace) => numbers(trace.y)),
    place: (frame, source) => [x, y].map((each) => each[frame * (vehicles + 1) + source]),
    told: (frame, n) => [0, 1].map((axis) => told[2 * (frame * attacked.length + n) + axis]),
    ahead: ahead && ((frame, vehicle) => ahead[frame * vehicles + vehicle - 1]),
    formation: shape && ((frame, vehicle) =>
      [0, 1].map((axis) => shape[2 * (frame * vehicles + vehicle - 1) + axis])),
    marked: (frame) => flags.map((each) => range(1, vehicles + 1)
      .filter((vehicle) => each?.[frame * vehicles + vehicle - 1])),
    fate: (frame, link) => (fates ? fates[link * time.length + frame] : 2),
  };
}

// Fill the figure of the plane with one frame: places in the plane, or around the centre.
function fill(figure, lane, frame, around) {
  const centre = (n) => (around ? lane.place(n, 0) : [0, 0]);
  const seen = (n, place) => place.map((value, axis) => value - centre(n)[axis]);
  const at = (source, n = frame) => seen(n, lane.place(n, source));
  const told = (_, n) => seen(frame, lane.told(frame, n));
  const first = around ? Math.max(0, frame - Math.ceil(lane.time.length / 4)) : 0;
  const trail = (vehicle) => range(first, frame + 1).map((n) => at(vehicle, n));
  const links = (retained) => lane.links
    .filter((_, n) => lane.fate(frame, n) > 1 === retained)
    .map(([listener, source]) => [at(source), at(listener)]);
  const lies = lane.attacked.map((_, n) => [at(lane.falsified[n]), told(_, n)]);
  const fleet = (vehicles) => ({
    paths: [vehicles.map((vehicle) => at(vehicle))],
    text: vehicles.map((vehicle) => lane.names[vehicle]),
    customdata: vehicles.map((vehicle) => lane.off[vehicle - 1][frame]),
    hovertemplate: lane.hover,
    angle: lane.ahead && vehicles.map((vehicle) => 270 - lane.ahead(frame, vehicle)), // from up
  });
  const [saturated, colliding] = lane.marked(frame);
  const filled = {
    dropped: { paths: links(false) },
    retained: { paths: links(true) },
    course: !lane.leaderless && { paths: [lane.frames.map((n) => at(0, n))] },
    trails: { paths: lane.honest.map(trail) },
    attackedTrails: { paths: lane.attacked.map(trail) },
    lies: { paths: lies },
    told: {
      paths: [lane.attacked.map(told)], text: lane.tells,
      customdata: lies.map(([[x0, y0], [x1, y1]]) => Math.hypot(x1 - x0, y1 - y0)),
    },
    honest: fleet(lane.honest),
    attacked: fleet(lane.attacked),
    formation: lane.formation && {
      paths: [lane.all.map((vehicle) => seen(frame, lane.formation(frame, vehicle)))],
      text: lane.all.map((vehicle) => `place of ${lane.names[vehicle]}`),
    },
    saturated: fleet(saturated),
    colliding: fleet(colliding),
    navigator: !lane.leaderless && { paths: [[at(0)]], text: ["navigator"] },
  };
  const isDrawn = ({ meta, marker }) => filled[meta] && (lane.ahead || !marker?.standoff);
  figure.data = figure.data.filter(isDrawn);
  for (const trace of figure.data) {
    const { paths, angle, ...words } = filled[trace.meta];
    const points = paths.flatMap((path) => [...path, [null, null]]); // a gap after each path
    Object.assign(trace, { x: points.map(([x]) => x), y: points.map(([, y]) => y), ...words });
    if (trace.marker?.standoff) trace.marker.angle = angle;
    if (trace.line) trace.line.shape = lane.shape;
  }
  const { xaxis, yaxis, shapes: [arena] } = figure.layout, reach = lane.reach[+around];
  const [[x0, x1], [y0, y1]] = (lane.arena ?? [0, 0])
    .map((half, axis) => [-half - centre(frame)[axis], half - centre(frame)[axis]]);
  Object.assign(arena, { x0, x1, y0, y1, visible: Boolean(lane.arena) });
  [xaxis, yaxis].forEach((axis, n) => {
    axis.range = [-reach, reach];
    axis.title = { text: lane.axes[+around][n] };
  });
  figure.layout.uirevision = `${lane.label}${around}`; // a zoom stays while time goes on
}

// What is saved of a lane, in full.
function placesOf(lane) {
  const sources = lane.leaderless ? lane.all : [0, ...lane.all];
  const told = (n, source) => {
    const place = lane.attacked.indexOf(source);
    return place < 0 || lane.falsified[place] === 0 ? [null, null] : lane.told(n, place);
  };
  const row = (n) => (source) =>
    [lane.time[n], source, ...lane.place(n, source), ...told(n, source)];
  const header = ["time", "vehicle", "x", "y", "told_x", "told_y"];
  return [header, ...lane.frames.flatMap((n) => sources.map(row(n)))];
}
function linksOf(lane) {
  const row = (n) => ([listener, source, lies], link) =>
    [lane.time[n], listener, source, +lies, +(lane.fate(n, link) > 1)];
  const header = ["time", "listener", "source", "attacked", "retained"];
  return [header, ...lane.frames.flatMap((n) => lane.links.map(row(n)))];
}

function showLanes(stage) {
  const section = stage.parentElement, [chooser, view] = all("select", stage);
  const slider = stage.querySelector("input"), play = stage.querySelector(".play");
  const clock = stage.querySelector("output"), [plane, errors, raster] = all(".plot", stage);
  let lane, timer;
  const frame = () => Number(slider.value);
  const around = () => view.selectedIndex === 0;
  const show = () => {
    const now = lane.time[frame()];
    redraw(plane);
    for (const each of [errors, raster])
      if (each.stale || !each.layout) redraw(each);
      else Plotly.relayout(each, { "shapes[0].x0": now, "shapes[0].x1": now });
    clock.textContent = `t = ${now.toFixed(2)} s`;
    slider.setAttribute("aria-valuetext", clock.textContent);
  };
  const stop = () => {
    clearInterval(timer);
    timer = undefined;
    play.textContent = "Play";
  };
  const go = (to) => {
    slider.value = to;
    show();
  };
  const toggle = () => {
    if (timer) return stop();
    if (slider.value === slider.max) slider.value = 0;
    play.textContent = "Pause";
    timer = setInterval(() => {
      go(frame() + 1);
      if (slider.value === slider.max) stop();
    }, STEP);
  };
  const choose = () => {
    stop();
    lane = unpacked(JSON.parse(document.getElementById(chooser.value).textContent));
    slider.max = lane.time.length - 1;
    section.querySelector(".said").textContent = lane.said;
    section.querySelector(".again").textContent = lane.command;
    view.options[0].textContent = lane.views;
    for (const each of [raster.closest(".panel"), stage.querySelector(".fates")])
      each.hidden = !lane.raster;
    errors.stale = raster.stale = true;
    go(lane.worst);
  };
  const offer = () => {
    const offered = all("option:not(.other)", chooser);
    stage.hidden = !offered.length;
    if (!offered.length) return stop();
    if (chooser.selectedOptions[0].disabled) chooser.value = offered[0].value;
    choose();
  };
  const toCursor = ({ layout: { shapes: [cursor] } }) => {
    cursor.x0 = cursor.x1 = lane.time[frame()];
  };
  plane.finish = (figure) => fill(figure, lane, frame(), around());
  plane.rows = () => placesOf(lane);
  Object.assign(errors, { figure: () => JSON.stringify(lane.errors), finish: toCursor });
  Object.assign(raster, { figure: () => JSON.stringify(lane.raster), rows: () => linksOf(lane) });
  raster.finish = (figure) => {
    const [trace] = figure.data;
    trace.text = lane.links.map(([listener, source], link) => {
      const hears = `${lane.names[listener]} hears ${lane.names[source]}`;
      return lane.frames.map((n) => `${hears}: ${FATES[lane.fate(n, link)]}`);
    });
    trace.x = Array.from(lane.time);
    toCursor(figure);
  };
  for (const each of [errors, raster])
    each.addEventListener("click", () => {
      const at = each._hoverdata?.[0]?.x; // plotly's, of the point under the pointer
      const distance = (n) => Math.abs(lane.time[n] - at);
      if (at === undefined) return;
      stop();
      go(lane.frames.reduce((best, n) => (distance(n) < distance(best) ? n : best)));
    });
  stage.addEventListener("keydown", (event) => {
    const by = { ArrowRight: 1, ArrowLeft: -1, Home: -Infinity, End: Infinity }[event.key];
    if (event.target !== stage || !(by || event.key === " ")) return;
    event.preventDefault();
    if (!by) return toggle();
    stop();
    go(Math.max(0, Math.min(+slider.max, frame() + by)));
  });
  play.addEventListener("click", toggle);
  slider.addEventListener("input", () => {
    stop();
    show();
  });
  chooser.addEventListener("change", choose);
  view.addEventListener("change", show);
  document.addEventListener("chosen", offer);
}
all(".stage").forEach(showLanes);
