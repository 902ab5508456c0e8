// Parallel projection of points in mm: turned by pointer or arrow keys, values under the pointer or by Home, End, Page Up and Page Down.

import { drawing, node, shape, line } from "./draw.js";
import { tableLink } from "./table.js";
import { shown } from "./words.js";

export const WIDTH = 460;
export const HEIGHT = 320;
const MARGIN = 44;
const NEAR = 16; // how far from a mark a pointer still finds its value
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

// Return a place of the volume in words.
export const placeWords = (point) => `X; Y; Z = ${point.map((value) => shown(value, 0)).join("; ")} mm`;

// A drawing in a place. draw() returns its label, its parts and its marks ({ at: [x, y], words }); table() the columns and rows behind it.
// Those of one list turn together.
export class Space {
  #chosen = null;
  #byKey = false; // a mark that was chosen by key stays until the pointer finds another
  #marks = [];

  constructor(place, name, draw, table, together = [this]) {
    this.draw = draw;
    this.together = together;
    this.place = place;
    this.sheet = node("div");
    this.value = node("output", { class: "value", "aria-live": "polite" });
    place.replaceChildren(this.sheet, this.value, tableLink(name, table));
    place.setAttribute("role", "group");
    place.tabIndex = 0;
    place.addEventListener("pointerdown", (event) => this.#press(event));
    place.addEventListener("pointermove", (event) => this.#move(event));
    place.addEventListener("pointerleave", ({ pointerType }) => pointerType === "mouse" && !this.#byKey && this.#choose(null));
    place.addEventListener("keydown", (event) => this.#key(event));
  }

  redraw() {
    const { label, parts, marks } = this.draw();
    this.#marks = marks;
    this.place.setAttribute("aria-label", label);
    const mark = marks[this.#chosen];
    const ring = mark ? [shape("circle", { class: "chosen", cx: mark.at[0], cy: mark.at[1], r: 9 })] : [];
    this.sheet.replaceChildren(drawing(WIDTH, HEIGHT, label, ...parts, ...ring));
    const words = mark?.words ?? "";
    if (this.value.textContent !== words) this.value.textContent = words;
  }

  #choose(index) {
    if (index === this.#chosen) return;
    this.#chosen = index;
    this.redraw();
  }

  #turn(right, up) {
    view.azimuth -= right;
    view.elevation = Math.min(90, Math.max(-90, view.elevation + up));
    for (const one of this.together) one.redraw();
  }

  // A finger that touches a mark asks for its value too.
  #press(event) {
    if (event.target.closest("a")) return;
    this.place.setPointerCapture(event.pointerId);
    this.#find(event);
  }

  // Browsers send a move of nothing when what is drawn changes below a pointer that rests: it took the value of a key away.
  #move(event) {
    if (event.movementX === 0 && event.movementY === 0) return;
    if (this.place.hasPointerCapture(event.pointerId)) this.#turn(event.movementX / 2, event.movementY / 2);
    else this.#find(event);
  }

  #find(event) {
    const seen = this.sheet.firstChild?.getScreenCTM()?.inverse();
    if (!seen) return;
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(seen);
    const far = this.#marks.map(({ at }) => Math.hypot(at[0] - x, at[1] - y));
    const nearest = Math.min(...far);
    this.#byKey = false;
    this.#choose(nearest <= NEAR ? far.indexOf(nearest) : null);
  }

  #key(event) {
    if (event.target !== this.place) return;
    const turn = { ArrowLeft: [-5, 0], ArrowRight: [5, 0], ArrowUp: [0, 5], ArrowDown: [0, -5] }[event.key];
    const last = this.#marks.length - 1;
    const at = this.#chosen ?? -1;
    const next = { Home: 0, End: last, PageDown: Math.min(last, at + 1), PageUp: Math.max(0, at - 1) }[event.key];
    if (!turn && next === undefined) return;
    event.preventDefault();
    if (turn) return this.#turn(...turn);
    if (last < 0) return;
    this.#byKey = true;
    this.#choose(next);
  }
}
