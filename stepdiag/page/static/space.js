// Parallel projection of points in mm, turned by pointer or arrow keys.

import { drawing, shape, line } from "./draw.js";

export const WIDTH = 460;
export const HEIGHT = 320;
const MARGIN = 44;
const view = { azimuth: -58, elevation: 22 };

function project([x, y, z]) {
  const [a, e] = [view.azimuth, view.elevation].map((angle) => (angle * Math.PI) / 180);
  return [-Math.sin(a) * x + Math.cos(a) * y, Math.sin(e) * (Math.cos(a) * x + Math.sin(a) * y) - Math.cos(e) * z];
}

// Return where points in mm lie on the sheet, by the edges of the box (pairs of points).
export function sheet(edges) {
  const corners = edges.flat();
  const middle = [0, 1, 2].map((axis) => (Math.min(...corners.map((one) => one[axis])) + Math.max(...corners.map((one) => one[axis]))) / 2);
  const flat = corners.map((corner) => project(corner.map((value, axis) => value - middle[axis])));
  const reach = [0, 1].map((axis) => 2 * Math.max(...flat.map((one) => Math.abs(one[axis]))));
  const scale = Math.min((WIDTH - 2 * MARGIN) / reach[0], (HEIGHT - 2 * MARGIN) / reach[1]);
  return (point) => {
    const [right, down] = project(point.map((value, axis) => value - middle[axis]));
    return [WIDTH / 2 + scale * right, HEIGHT / 2 + scale * down];
  };
}

// Return the box with the names of its axes.
export function box({ edges_mm: edges, axes }, place) {
  const [origin] = edges[0];
  const same = (a, b) => a.every((value, axis) => value === b[axis]);
  const sides = edges.map((edge) => shape("path", { class: edge.some((end) => same(end, origin)) ? "edge origin" : "edge", d: line(edge.map(place)) }));
  const names = axes.map(([name, at]) => {
    const [x, y] = place(at);
    return shape("text", { class: "axis middle strong", x, y: y + 4 }, name);
  });
  return [...sides, ...names];
}

export const picture = (label, parts) => drawing(WIDTH, HEIGHT, label, ...parts);

// Let a place be turned; redraw is called after each turn.
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
