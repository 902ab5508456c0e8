// Help while the mirror is being aligned: its tilt as far as it belongs to this setup, and strength or steadiness over two minutes.

import { Curves } from "./curves.js";
import { put } from "./draw.js";
import { STALE_MS } from "./stream.js";
import { say, setupName, shown } from "./words.js";

const KEEP_S = 120;
const SAMPLE_S = 0.5;
const GOOD_MRAD = 0.5;
const REALIGN_MRAD = 2; // beyond this the second-order term and the spot's walk on the mirror are no longer small

const trend = [];
let curves = null;

export function forget() {
  curves?.forget();
  if (trend.length) draw();
}

export function update(snapshot) {
  tilt(snapshot);
  const { beam, beam_lost: lost, laser, strip } = snapshot;
  const now = performance.now() / 1000;
  if (trend.length && now - trend.at(-1).time < SAMPLE_S && reported === (beam !== null)) return;
  const live = laser.age_s !== null && laser.age_s < STALE_MS / 1000;
  const high = strip?.high_mm.filter((value) => value !== null) ?? [];
  const low = strip?.low_mm.filter((value) => value !== null) ?? [];
  const noise = live && !lost && high.length ? (Math.max(...high) - Math.min(...low)) * 1e3 : null;
  trend.push({ time: now, beam: live && !lost && beam !== null ? 100 * beam : null, noise });
  while (now - trend[0].time > KEEP_S) trend.shift();
  if (snapshot.stage === "set-up" || snapshot.stage === "align") draw(beam !== null);
}

// A tilt belongs to the setup whose steps it was found from: between setups the mirror has been moved, so it is shown as past.
function tilt({ tilt_mrad: parts, tilt_setup: setup, expects_setup: expected, tilt_live: live }) {
  const size = parts ? Math.hypot(...parts) : null;
  const words = parts ? `${shown(size, 2)} mrad (${parts.map((part) => shown(part, 2)).join(" / ")})` : "–";
  put("tilt", parts && !live ? `${words}, ${setupName(setup)}` : words).classList.toggle("past", Boolean(parts) && !live);
  const grade = size === null || !live || setup !== expected ? "none" : size <= GOOD_MRAD ? "good" : size <= REALIGN_MRAD ? "fair" : "bad";
  put("tilt-advice", say(`tilt_${grade}`, { limit: shown(REALIGN_MRAD, 0) })).className = `note ${grade}`;
  put("tilt-drive", grade === "none" ? "" : `${say("tilt")}: ${words}. ${say(`tilt_${grade}`, { limit: shown(REALIGN_MRAD, 0) })}`).className = `note ${grade}`;
}

let reported = true;

function draw(strength = reported) {
  reported = strength;
  const last = trend.at(-1).time;
  const x = trend.map(({ time }) => time - last);
  const words = say(strength ? "trend_beam" : "trend_noise");
  put("h-trend", words);
  const y = trend.map(({ beam, noise }) => (strength ? beam : noise));
  curves ??= new Curves("trend", { height: 130, xRange: [-KEEP_S, 0], decimals: 1 });
  curves.draw([{ label: say(strength ? "beam" : "noise"), x, y, dots: false }], words, { columns: ["time_s", strength ? "beam_percent" : "noise_um"], xLabel: say("seconds"), yLabel: strength ? "%" : "µm", yRange: strength ? [0, 100] : null });
}
