// The volume before and after compensation, its errors drawn to one scale; both turn together.

import { line, node, shape } from "./draw.js";
import { box, placeWords, sheet, Space } from "./space.js";
import { say, shown } from "./words.js";

const LONGEST_PX = 44;
const COLUMNS = ["x_mm", "y_mm", "z_mm", "dx_um", "dy_um", "dz_um"];

// Show the fields (points_mm, before_um, after_um or null) in a place.
export function field(place, { points_mm: points, before_um: before, after_um: after, longest_um: longest }, geometry) {
  const shows = [["before", before], ["after", after]].filter(([, errors]) => errors);
  const figures = shows.map(([name]) => node("figure", {}, node("figcaption", {}, say(name)), node("div", { class: "drawing turns", id: `field-${name}` })));
  place.replaceChildren(...figures, node("p", { class: "quiet across" }, say(shows.length > 1 ? "field_scale_both" : "field_scale", { um: shown(longest, longest < 10 ? 1 : 0) })));
  const together = [];
  for (const [name, errors] of shows) {
    const draw = () => ({ label: say(name), ...drawn(points, errors, longest, geometry) });
    const table = () => [COLUMNS, points.map((point, index) => [...point, ...errors[index]])];
    together.push(new Space(document.getElementById(`field-${name}`), `field-${name}`, draw, table, together));
  }
  for (const one of together) one.redraw();
}

function drawn(points, errors, longest, geometry) {
  const at = sheet(geometry.edges_mm);
  const origin = at([0, 0, 0]);
  const unit = [0, 1, 2].map((axis) => at([0, 1, 2].map((one) => (one === axis ? 1 : 0))).map((value, index) => value - origin[index]));
  const length = Math.max(...unit.map(([x, y]) => Math.hypot(x, y))) || 1;
  const size = errors.map((error) => Math.hypot(...error));
  const worst = size.indexOf(Math.max(...size));
  const parts = box(geometry, at);
  const marks = [];
  points.forEach((point, index) => {
    const [x, y] = at(point);
    const [dx, dy] = [0, 1].map((side) => (errors[index].reduce((sum, value, axis) => sum + value * unit[axis][side], 0) / length / longest) * LONGEST_PX);
    marks.push({ at: [x + dx, y + dy], words: vectorWords(point, errors[index]) });
    const kind = index === worst ? "error worst" : `error f${Math.min(4, Math.floor((5 * size[index]) / longest))}`;
    parts.push(shape("path", { class: kind, d: line([[x, y], [x + dx, y + dy]]) }), shape("circle", { class: kind, cx: x + dx, cy: y + dy, r: index === worst ? 5 : 2 }));
  });
  return { parts, marks };
}

const vectorWords = (point, error) => `${placeWords(point)}: ${error.map((value) => shown(value, 2)).join("; ")} µm, |E| = ${shown(Math.hypot(...error), 2)} µm`;
