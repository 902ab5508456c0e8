// Curves by uPlot (vendor/), in the colours of the page: zoom by dragging, back by a double click or Escape, values under the pointer or by arrow keys.

import { tableLink } from "./table.js";
import { shown } from "./words.js";

const COVERAGE = 2;
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const LINES = ["--accent", "--second", "--good", "--warn"];
// Steps of an axis that counts: between two stops there is none.
const COUNTS = [1, 10, 100, 1000].flatMap((ten) => [1, 2, 5].map((each) => each * ten));
const DASHES = [[], [6, 3], [2, 3], [8, 3, 2, 3]];

// A place holds one plot. Series: { label, x: [], y: [], u: [] | null, odd: [] of truth, dots }; all share x. A null in y is a gap.
// The option columns names what stands in its CSV: x, then y and, where there is one, u of every series.
export class Curves {
  #plot = null;
  #shape = "";
  #series = [];

  constructor(id, options) {
    this.place = document.getElementById(id);
    this.options = { height: 190, decimals: 2, xRange: null, yRange: null, counts: false, legend: true, ...options };
    new ResizeObserver(() => this.#plot?.setSize({ width: this.#width(), height: this.#height() })).observe(this.place);
  }

  forget() {
    this.#shape = "";
  }

  #width = () => Math.max(160, Math.floor(this.place.clientWidth));
  #height = () => Math.max(120, Math.min(this.options.height, Math.floor(innerHeight * 0.4)));

  draw(series, label, options = {}) {
    Object.assign(this.options, options);
    this.#series = series;
    this.place.dataset.points = JSON.stringify(series.map(({ y }) => y.filter((value) => value !== null).length));
    const data = [series[0]?.x ?? [], ...series.flatMap(({ y, u }) => (u ? [y, ...bounds(y, u)] : [y]))];
    const shape = JSON.stringify([label, series.map(({ label: name, u }) => [name, Boolean(u)]), this.options]);
    this.odd = series.map(({ odd }) => odd ?? []);
    if (shape === this.#shape) return void this.#plot.setData(data, !this.#zoomed());
    this.#shape = shape;
    this.#plot?.destroy();
    this.place.replaceChildren(tableLink(this.place.id.replace("function-", ""), () => this.#table()));
    this.#plot = new uPlot(this.#build(series, label), data, this.place);
    this.#name(label);
  }

  #table() {
    const data = [this.#series[0].x, ...this.#series.flatMap(({ y, u }) => (u ? [y, u] : [y]))];
    const { columns, firstX = 0 } = this.options; // programs count from 0 what a person counts from 1
    return [columns, data[0].map((x, row) => [x - firstX, ...data.slice(1).map((column) => column[row])])];
  }

  #zoomed() {
    const { min, max } = this.#plot.scales.x;
    const [low, high] = this.#range(null, ...ends(this.#plot.data[0]));
    return Math.abs(min - low) > 1e-9 || Math.abs(max - high) > 1e-9;
  }

  // A part that a person chose stays what it is; the whole is the chart's own range, or that of its data.
  #range = (plot, low, high) => {
    const [first, last] = ends(plot?.data?.[0] ?? [low, high]);
    if (low > first || high < last) return [low, high];
    const own = this.options.xRange;
    if (own) return [Math.min(...own), Math.max(...own)];
    return low < high ? [low, high] : [(low ?? 0) - 1, (high ?? 0) + 1];
  };

  #build(series, label) {
    const { xLabel, yLabel, decimals, yRange, counts, ySpace } = this.options;
    const value = (_plot, given) => shown(given, decimals);
    const axis = { stroke: colour("--quiet"), grid: { stroke: colour("--grid"), width: 1 }, ticks: { stroke: colour("--grid") }, font: "12px system-ui", labelFont: "12px system-ui", labelSize: 20 };
    const lines = [{ label: xLabel, value: (_plot, given) => shown(given, Number.isInteger(given) ? 0 : 2) }];
    const bands = [];
    series.forEach(({ label: name, u, dots = true }, order) => {
      const stroke = colour(LINES[order % LINES.length]);
      lines.push({ label: name, stroke, width: 2, dash: DASHES[order % DASHES.length], points: { show: dots, size: 5 }, value, spanGaps: false });
      if (!u) return;
      const at = lines.length;
      for (const side of ["+", "−"]) lines.push({ label: `${side}U`, class: "bound", stroke: "transparent", width: 0, points: { show: false }, value });
      bands.push({ series: [at, at + 1], fill: `${stroke}33` });
    });
    return {
      width: this.#width(),
      height: this.#height(),
      title: undefined,
      series: lines,
      bands,
      legend: { live: true, show: this.options.legend },
      cursor: { drag: { x: true, y: false }, points: { size: 8 } },
      scales: { x: { time: false, range: this.#range }, y: { range: yRange ?? around } },
      axes: [
        { ...axis, label: xLabel, size: 34, incrs: counts ? COUNTS : undefined, values: (_plot, marks) => marks.map((mark) => shown(mark, places(marks))) },
        { ...axis, label: yLabel, size: 54, ...(ySpace && { space: ySpace }), values: (_plot, marks) => marks.map((mark) => shown(mark, places(marks))) },
      ],
      hooks: { draw: [(plot) => this.#marks(plot, series)], setScale: [(plot, key) => key === "x" && this.#show(plot.scales.x)] },
      focus: { alpha: 1 },
      label,
    };
  }

  // Which part is shown can be read by whoever does not see the drawing.
  #show({ min, max }) {
    this.place.dataset.range = JSON.stringify([min, max].map((end) => Math.round(end * 100) / 100));
  }

  // Doubtful points get a cross of their own: colour alone does not tell.
  #marks(plot, series) {
    const { ctx } = plot;
    ctx.save();
    ctx.strokeStyle = colour("--bad");
    ctx.lineWidth = 3;
    let column = 1;
    series.forEach(({ u }, order) => {
      (this.odd[order] ?? []).forEach((odd, index) => {
        const value = plot.data[column][index];
        if (!odd || value === null || value === undefined) return;
        const [x, y] = [plot.valToPos(plot.data[0][index], "x", true), plot.valToPos(value, "y", true)];
        ctx.beginPath();
        for (const [a, b] of [[-7, -7], [-7, 7]]) {
          ctx.moveTo(x + a, y + b);
          ctx.lineTo(x - a, y - b);
        }
        ctx.stroke();
      });
      column += u ? 3 : 1;
    });
    ctx.restore();
  }

  #name(label) {
    const over = this.#plot.root.querySelector(".u-over");
    const canvas = this.#plot.root.querySelector("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", label);
    over.tabIndex = 0;
    over.setAttribute("role", "group");
    over.setAttribute("aria-label", label);
    over.addEventListener("keydown", (event) => this.#key(event));
  }

  #key(event) {
    const plot = this.#plot;
    const last = plot.data[0].length - 1;
    const at = plot.cursor.idx ?? -1;
    const next = { ArrowRight: at + 1, ArrowLeft: at - 1, Home: 0, End: last }[event.key];
    if (event.key === "Escape") return void plot.setData(plot.data, true);
    if (next === undefined || last < 0) return;
    event.preventDefault();
    const index = Math.min(last, Math.max(0, next));
    plot.setCursor({ left: plot.valToPos(plot.data[0][index], "x"), top: plot.valToPos(plot.data[1][index] ?? 0, "y") });
  }
}

const bounds = (y, u) => [1, -1].map((side) => y.map((value, index) => (value === null || u[index] === null ? null : value + side * COVERAGE * u[index])));
const ends = (x) => [x[0], x.at(-1)];
const around = (_plot, low, high) => {
  const [from, to] = [Math.min(0, low ?? 0), Math.max(0, high ?? 0)];
  const room = Math.max(0.08 * (to - from), 0.05);
  return [from - (from < 0 ? room : 0.2 * room), to + room];
};

// Decimals that every mark of an axis needs: marks every 2.5 are not written 3, 5, 8.
export function places(marks) {
  const step = marks.length > 1 ? Math.abs(marks[1] - marks[0]) : 1;
  let count = 0;
  while (count < 6 && Math.abs(step * 10 ** count - Math.round(step * 10 ** count)) > 1e-6 * step * 10 ** count) count += 1;
  return count;
}
