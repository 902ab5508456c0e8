// The last ten seconds at full rate: lowest and highest sample of every bin, so that no reading of the laser is left out.

import { Curves } from "./curves.js";
import { put } from "./draw.js";
import { say, shown } from "./words.js";

const KEEP_S = 10;

let bins = new Map();
let curves = null;
let asked = 0;
let reach = null; // half the height of the strip in µm while the machine stands: the way to the plateau leaves the picture

export function forget() {
  curves?.forget();
}

export function update({ strip, stage }) {
  if (!strip) return;
  const { first, bin_s: width, low_mm: low, high_mm: high } = strip;
  low.forEach((value, index) => bins.set(first + index, [value, high[index]]));
  const newest = first + low.length - 1;
  const oldest = newest - Math.round(KEEP_S / width) + 1;
  bins = new Map([...bins].filter(([index]) => index >= oldest && index <= newest));
  if (performance.now() - asked < 90 || stage === "done") return;
  asked = performance.now();
  draw(oldest, newest, width);
}

function draw(oldest, newest, width) {
  const x = [];
  const low = [];
  const high = [];
  const middle = [];
  for (let index = oldest; index <= newest; index += 1) {
    const pair = bins.get(index);
    x.push((index - newest) * width);
    low.push(pair?.[0] ?? null);
    high.push(pair?.[1] ?? null);
    if (pair && pair[0] !== null) middle.push((pair[0] + pair[1]) / 2);
  }
  const { zero = middle.at(-1) ?? 0, spread } = plateau(newest, width) ?? {};
  const moving = spread === undefined && Math.max(...middle) - Math.min(...middle) > 1; // a travel is read in mm, a standstill in µm
  reach = moving || spread === undefined ? null : Math.max(0.5, 2 * spread);
  const shift = (column) => column.map((value) => (value === null ? null : (value - zero) * (moving ? 1 : 1e3)));
  curves ??= new Curves("strip", { height: 150, ySpace: 16, xRange: [-KEEP_S, 0], yRange: narrow });
  const unit = moving ? "mm" : "um";
  const labels = { columns: ["time_s", `high_${unit}`, `low_${unit}`], xLabel: say("seconds"), yLabel: moving ? "mm" : "µm" };
  curves.draw([{ label: say("strip_high"), x, y: shift(high), dots: false }, { label: say("strip_low"), x, y: shift(low), dots: false }], say("strip"), labels);
  put("scatter", spread === undefined ? "" : say("scatter", { um: shown(spread, 2), mm: shown(zero, 4) }));
}

const MOST_UM = 100; // a machine that moves has no scatter

// Return the middle (mm) and the range (µm) of the samples within the last half second; null while the machine moves.
function plateau(newest, width) {
  const last = [...bins].filter(([index, pair]) => index > newest - 0.5 / width && pair[0] !== null).map(([, pair]) => pair);
  if (!last.length) return null;
  const [low, high] = [Math.min(...last.map(([one]) => one)), Math.max(...last.map(([, one]) => one))];
  return (high - low) * 1e3 <= MOST_UM ? { zero: (low + high) / 2, spread: (high - low) * 1e3 } : null;
}

// A standing machine is looked at through a microscope, a moving one is not.
const narrow = (_plot, low, high) => (reach !== null ? [-reach, reach] : low === null || high - low < 1 ? [-0.5 + ((low ?? 0) + (high ?? 0)) / 2, 0.5 + ((low ?? 0) + (high ?? 0)) / 2] : [low, high]);
