// The volume, the route being driven and the stops done. Every place comes from the daemon (stepdiag/page/geometry.py).

import { line, shape } from "./draw.js";
import { box, placeWords, sheet } from "./space.js";
import { wordsOf } from "./words.js";

const COLUMNS = ["setup", "pass", "stop", "x_mm", "y_mm", "z_mm", "deviation_um", "u_um", "doubtful"];

const shownStops = ({ stops, expects_setup: setup }) => stops.filter((one) => !setup || one.setup === setup);

// Return the parts of the drawing and its marks: every stop in the words that say says of it, with its place.
export function volume(snapshot, say) {
  const { geometry, commanded_mm: commanded } = snapshot;
  const place = sheet(geometry.edges_mm);
  const parts = box(geometry, place);
  for (const { state, ends_mm: ends } of geometry.ways) parts.push(shape("path", { class: `diagonal ${state}`, d: line(ends.map(place)) }));
  const driven = geometry.route_mm.map(place);
  if (driven.length) parts.push(shape("path", { class: "route", d: line(driven) }), ...arrow(driven));
  const stops = shownStops(snapshot);
  const marks = stops.map((stop) => ({ at: place(stop.position_mm), words: `${say(stop)}, ${placeWords(stop.position_mm)}` }));
  stops.forEach((stop, index) => parts.push(mark(marks[index].at, Boolean(wordsOf(stop.doubtful)))));
  if (commanded) {
    const [cx, cy] = place(commanded);
    parts.push(shape("circle", { class: "tool", cx, cy, r: 7 }));
  }
  return { parts, marks };
}

// Return the columns and rows behind the drawing.
export function stopsTable(snapshot) {
  const rows = shownStops(snapshot).map((one) => [one.setup, one.pass_number, one.place, ...one.position_mm, one.deviation_um, one.u_um, wordsOf(one.doubtful)]);
  return [COLUMNS, rows];
}

// A doubtful stop is a cross, not only another colour.
function mark([x, y], doubtful) {
  if (!doubtful) return shape("circle", { class: "stop", cx: x, cy: y, r: 4 });
  const [a, b, c, d] = [x - 6, x + 6, y - 6, y + 6];
  return shape("path", { class: "stop doubt", d: `${line([[a, c], [b, d]])}${line([[a, d], [b, c]])}` });
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
