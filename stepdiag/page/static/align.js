// Help while the mirror is being aligned: beam strength and mirror tilt over the last two minutes, and advice.

import { chart } from "./chart.js";
import { put } from "./draw.js";
import { STALE_MS } from "./stream.js";
import { say, shown } from "./words.js";

const KEEP_S = 120;
const SAMPLE_S = 0.5;
const GOOD_MRAD = 0.5;
const REALIGN_MRAD = 2; // beyond this the second-order term and the spot's walk on the mirror are no longer small

const trend = [];

export function forget() {
  if (trend.length) draw();
}

export function update({ beam, beam_lost: lost, tilt_mrad: tilt, laser }) {
  const size = tilt ? Math.hypot(...tilt) : null;
  put("tilt", tilt ? `${shown(size, 2)} mrad (${tilt.map((part) => shown(part, 2)).join(" / ")})` : "–");
  const grade = size === null ? "none" : size <= GOOD_MRAD ? "good" : size <= REALIGN_MRAD ? "fair" : "bad";
  put("tilt-advice", say(`tilt_${grade}`, { limit: shown(REALIGN_MRAD, 0) })).className = `advice ${grade}`;
  const now = performance.now() / 1000;
  if (trend.length && now - trend.at(-1).time < SAMPLE_S) return;
  const known = !lost && beam !== null && laser.age_s !== null && laser.age_s < STALE_MS / 1000;
  trend.push({ time: now, beam: known ? 100 * beam : null, tilt });
  while (now - trend[0].time > KEEP_S) trend.shift();
  draw();
}

function draw() {
  const last = trend.at(-1).time;
  const x = trend.map(({ time }) => last - time);
  const options = { xRange: [KEEP_S, 0], xLabel: say("seconds_ago"), height: 150 };
  const strength = [{ label: say("beam"), x, y: trend.map(({ beam }) => beam), u: null, dots: false }];
  show("trend-beam", chart(strength, { ...options, label: say("trend_beam"), yLabel: "%", yRange: [0, 100] }));
  const parts = [0, 1].map((part) => ({ label: `${part + 1}`, x, y: trend.map(({ tilt }) => tilt?.[part] ?? null), u: null, dots: false }));
  show("trend-tilt", chart(parts, { ...options, label: say("trend_tilt"), yLabel: "mrad" }));
}

function show(id, svg) {
  document.getElementById(id).replaceChildren(svg);
}
