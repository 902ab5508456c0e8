// Deviations of the running pass stop by stop, the return pass laid over the outward pass.

import { chart } from "./chart.js";
import { node, put } from "./draw.js";
import { say, setupName, shown } from "./words.js";

let drawn = "";

export function forget() {
  drawn = "";
}

export function update({ stops, stops_in_pass: count }) {
  const last = stops.at(-1);
  put("last-stop", last ? words(last) : "");
  const key = `${count}|${stops.map((one) => `${one.setup}${one.pass_number}.${one.stop}:${one.deviation_um}${one.doubtful}`).join()}`;
  if (key === drawn) return;
  drawn = key;
  const place = document.getElementById("deviations");
  if (!last) return place.replaceChildren(node("p", { class: "quiet" }, say("no_stops")));
  const series = passes(stops.filter((one) => one.setup === last.setup), count);
  const options = { xLabel: say("stop_axis"), yLabel: say("deviation_axis"), xRange: [0, Math.max(1, count - 1)] };
  place.replaceChildren(chart(series, { ...options, label: `${say("deviations")}: ${setupName(last.setup)}` }));
}

function words({ setup, stop, deviation_um: deviation, doubtful }) {
  const told = `${setupName(setup)}. ${say("last_stop", { stop, deviation: shown(deviation, 2) })}`;
  return doubtful ? `${told} (${say("doubtful", { reason: doubtful })})` : told;
}

// Return one series a pass over the outward stops. A return pass counts from the far end and from zero there, so it is
// hung onto the last deviation of the outward pass before it.
function passes(stops, count) {
  const numbers = [...new Set(stops.map((one) => one.pass_number))].sort((a, b) => a - b);
  let far = 0;
  return numbers.map((number) => {
    const outward = number % 2 === 1;
    const own = stops.filter((one) => one.pass_number === number);
    const at = Array(count).fill(null);
    const u = Array(count).fill(null);
    for (const one of own) {
      const index = outward ? one.stop : count - 1 - one.stop;
      at[index] = one.deviation_um + (outward ? 0 : far);
      u[index] = Number.isFinite(one.u_um) ? one.u_um : 0;
    }
    if (outward) far = at[count - 1] ?? 0;
    return { label: `${number}: ${say(outward ? "outward" : "return")}`, x: at.map((_, index) => index), y: at, u };
  });
}
