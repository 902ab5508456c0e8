// A chart of lines with optional k=2 bands. Series: { label, x: [], y: [], u: [] | null }; null in y is a gap.

import { drawing, line, shape } from "./draw.js";
import { shown } from "./words.js";

const LEFT = 52;
const RIGHT = 10;
const TOP = 10;
const BOTTOM = 34;
const COVERAGE = 2;

// Return round values that cover a range, whichever way it runs.
function ticks(from, to, wanted = 4) {
  const [low, high] = [Math.min(from, to), Math.max(from, to)];
  const raw = (high - low) / wanted;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((candidate) => candidate >= raw * (1 - 1e-9));
  const marks = [];
  for (let index = Math.floor(low / step + 1e-9); index <= Math.ceil(high / step - 1e-9); index += 1) marks.push(index * step);
  return { marks, decimals: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

function reach(series, fixed) {
  if (fixed) return fixed;
  let low = 0;
  let high = 0;
  for (const { y, u } of series) {
    y.forEach((value, index) => {
      if (value === null) return;
      const half = COVERAGE * (u?.[index] ?? 0);
      low = Math.min(low, value - half);
      high = Math.max(high, value + half);
    });
  }
  return high - low < 1e-9 ? [-1, 1] : [low, high];
}

// Return the stretches of a series without gaps, as indices.
function stretches(y) {
  const found = [[]];
  y.forEach((value, index) => (value === null ? found.push([]) : found.at(-1).push(index)));
  return found.filter((stretch) => stretch.length);
}

export function chart(series, { label, xLabel = "", yLabel = "", xRange, yRange = null, width = 460, height = 230 }) {
  const vertical = ticks(...reach(series, yRange));
  const [low, high] = [vertical.marks[0], vertical.marks.at(-1)];
  const px = (x) => LEFT + ((x - xRange[0]) / (xRange[1] - xRange[0])) * (width - LEFT - RIGHT);
  const py = (y) => height - BOTTOM - ((y - low) / (high - low)) * (height - BOTTOM - TOP);
  const parts = frame(vertical, ticks(...xRange), { px, py, xRange, width, height, xLabel, yLabel });
  series.forEach((one, order) => parts.push(...band(one, order, px, py)));
  series.forEach((one, order) => parts.push(...trace(one, order, px, py)));
  if (series.length > 1) parts.push(...legend(series));
  return drawing(width, height, label, ...parts);
}

function frame(vertical, horizontal, { px, py, xRange, width, height, xLabel, yLabel }) {
  const parts = [];
  for (const mark of vertical.marks) {
    const kind = Math.abs(mark) < 1e-12 ? "zero" : "grid";
    parts.push(shape("path", { class: kind, d: line([[LEFT, py(mark)], [width - RIGHT, py(mark)]]) }));
    parts.push(shape("text", { class: "tick end", x: LEFT - 5, y: py(mark) + 4 }, shown(mark, vertical.decimals)));
  }
  const [left, right] = [Math.min(...xRange), Math.max(...xRange)];
  for (const mark of horizontal.marks.filter((value) => value >= left - 1e-9 && value <= right + 1e-9)) {
    parts.push(shape("text", { class: "tick middle", x: px(mark), y: height - BOTTOM + 14 }, shown(mark, horizontal.decimals)));
  }
  parts.push(shape("text", { class: "axis middle", x: (LEFT + width) / 2, y: height - 5 }, xLabel));
  const middle = (height - BOTTOM + TOP) / 2;
  parts.push(shape("text", { class: "axis middle", x: 11, y: middle, transform: `rotate(-90 11 ${middle})` }, yLabel));
  return parts;
}

function band({ x, y, u }, order, px, py) {
  if (!u) return [];
  return stretches(y.map((value, index) => (u[index] === null ? null : value))).map((stretch) => {
    const upper = stretch.map((index) => [px(x[index]), py(y[index] + COVERAGE * u[index])]);
    const lower = stretch.map((index) => [px(x[index]), py(y[index] - COVERAGE * u[index])]);
    return shape("path", { class: `band s${order}`, d: `${line([...upper, ...lower.reverse()])}Z` });
  });
}

function trace({ x, y, dots = true }, order, px, py) {
  return stretches(y).flatMap((stretch) => {
    const points = stretch.map((index) => [px(x[index]), py(y[index])]);
    const marks = dots ? points.map(([cx, cy]) => shape("circle", { class: `dot s${order}`, cx, cy, r: 2.4 })) : [];
    return [shape("path", { class: `line s${order}`, d: line(points) }), ...marks];
  });
}

function legend(series) {
  let at = LEFT + 6;
  return series.flatMap(({ label }, order) => {
    const parts = [
      shape("path", { class: `line s${order}`, d: line([[at, TOP + 4], [at + 18, TOP + 4]]) }),
      shape("text", { class: "tick", x: at + 23, y: TOP + 8 }, label),
    ];
    at += 40 + 7 * label.length;
    return parts;
  });
}
