// The volume in parallel projection: its box, the route being driven, the stops done. Turns by pointer or arrow keys.

import { drawing, line, shape } from "./draw.js";

const WIDTH = 460;
const HEIGHT = 320;
const MARGIN = 44;
const view = { azimuth: -58, elevation: 22 };

function project([x, y, z]) {
  const [a, e] = [view.azimuth, view.elevation].map((angle) => (angle * Math.PI) / 180);
  return [-Math.sin(a) * x + Math.cos(a) * y, Math.sin(e) * (Math.cos(a) * x + Math.sin(a) * y) - Math.cos(e) * z];
}

// Return where points in mm lie on the sheet.
function sheet({ origin_mm: origin, size_mm: size }) {
  const middle = origin.map((low, axis) => low + size[axis] / 2);
  const corners = [...Array(8).keys()].map((corner) => project(size.map((length, axis) => (((corner >> axis) & 1) - 0.5) * length)));
  const reach = [0, 1].map((axis) => 2 * Math.max(...corners.map((corner) => Math.abs(corner[axis]))));
  const scale = Math.min((WIDTH - 2 * MARGIN) / reach[0], (HEIGHT - 2 * MARGIN) / reach[1]);
  return (point) => {
    const [right, down] = project(point.map((value, axis) => value - middle[axis]));
    return [WIDTH / 2 + scale * right, HEIGHT / 2 + scale * down];
  };
}

// Return the commanded positions of a setup's outward pass; the steps follow X, Y, Z.
export function route(setup, { origin_mm: origin, size_mm: size, increments }) {
  const [base] = setup.split("+");
  const axis = "xyz".indexOf(base.split("-")[1] ?? " ");
  const moves = axis >= 0 ? [axis] : [0, 1, 2];
  const signs = axis >= 0 ? "ppp" : base;
  const at = origin.map((low, index) => (signs[index] === "p" ? low : low + size[index]));
  const stops = [[...at]];
  for (let step = 0; step < increments; step += 1) {
    for (const moved of moves) {
      at[moved] += ((signs[moved] === "p" ? 1 : -1) * size[moved]) / increments;
      stops.push([...at]);
    }
  }
  return stops;
}

export function volume(snapshot, label) {
  const place = sheet(snapshot);
  const parts = [...box(snapshot, place), ...diagonals(snapshot, place)];
  if (/^[pn]{3}|-[xyz]/.test(snapshot.expects_setup)) {
    const driven = route(snapshot.expects_setup, snapshot).map(place);
    parts.push(shape("path", { class: "route", d: line(driven) }), ...arrow(driven));
  }
  const setup = snapshot.expects_setup;
  for (const stop of snapshot.stops.filter((one) => !setup || one.setup === setup)) {
    const [cx, cy] = place(stop.position_mm);
    parts.push(shape("circle", { class: stop.doubtful ? "stop doubt" : "stop", cx, cy, r: 4 }));
  }
  if (snapshot.commanded_mm) {
    const [cx, cy] = place(snapshot.commanded_mm);
    parts.push(shape("circle", { class: "tool", cx, cy, r: 7 }));
  }
  return drawing(WIDTH, HEIGHT, label, ...parts);
}

function box({ origin_mm: origin, size_mm: size }, place) {
  const corner = (index) => place(origin.map((low, axis) => low + ((index >> axis) & 1) * size[axis]));
  const parts = [];
  for (let a = 0; a < 8; a += 1) {
    for (const bit of [1, 2, 4].filter((bit) => !(a & bit))) {
      parts.push(shape("path", { class: a === 0 ? "edge origin" : "edge", d: line([corner(a), corner(a | bit)]) }));
    }
  }
  const far = Math.max(...size) * 0.06;
  for (let axis = 0; axis < 3; axis += 1) {
    const [x, y] = place(origin.map((low, index) => low + (index === axis ? size[index] + far : 0)));
    parts.push(shape("text", { class: "axis middle strong", x, y: y + 4 }, "XYZ"[axis]));
  }
  return parts;
}

function diagonals(snapshot, place) {
  const names = snapshot.setups.map((setup) => setup.name).filter((name) => /^[pn]{3}$/.test(name));
  return names.map((name) => {
    const stops = route(name, snapshot);
    const { state } = snapshot.setups.find((setup) => setup.name === name);
    return shape("path", { class: `diagonal ${state}`, d: line([place(stops[0]), place(stops.at(-1))]) });
  });
}

// Return the mark of the start and the head of the arrow at the end of a route.
function arrow(driven) {
  const [start, end] = [driven[0], driven.at(-1)];
  const turn = Math.atan2(end[1] - start[1], end[0] - start[0]);
  const wing = (side) => [end[0] - 12 * Math.cos(turn + side), end[1] - 12 * Math.sin(turn + side)];
  return [
    shape("path", { class: "route head", d: line([wing(0.4), end, wing(-0.4)]) }),
    shape("circle", { class: "start", cx: start[0], cy: start[1], r: 6 }),
  ];
}

// Let a place be turned by pointer and arrow keys; redraw is called after each turn.
export function turnable(place, redraw) {
  const turn = (right, up) => {
    view.azimuth -= right;
    view.elevation = Math.min(90, Math.max(-90, view.elevation + up));
    redraw();
  };
  const keys = { ArrowLeft: [-5, 0], ArrowRight: [5, 0], ArrowUp: [0, 5], ArrowDown: [0, -5] };
  place.tabIndex = 0;
  place.addEventListener("pointerdown", (event) => place.setPointerCapture(event.pointerId));
  place.addEventListener("pointermove", (event) => {
    if (place.hasPointerCapture(event.pointerId)) turn(event.movementX / 2, event.movementY / 2);
  });
  place.addEventListener("keydown", (event) => {
    if (!(event.key in keys)) return;
    event.preventDefault();
    turn(...keys[event.key]);
  });
}
