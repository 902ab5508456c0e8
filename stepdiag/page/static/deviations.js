// Deviations of the running setup over the stops of its outward way; both directions share sign, numbering and zero, which the daemon sees to.

import { Curves } from "./curves.js";
import { put } from "./draw.js";
import { say, setupName, shown, wayOf, wordsOf } from "./words.js";

let drawn = "";
let curves = null;

export function forget() {
  drawn = "";
  curves?.forget();
}

export function update({ stops, stops_in_pass: count, setups, stage }) {
  const last = stops.at(-1);
  put("last-stop", last ? words(last) : say("no_stops"));
  if (!last || stage === "done") return;
  const of = stops.filter((one) => one.setup === last.setup);
  const places = frame(count, of, setups);
  const key = `${places}|${of.map((one) => `${one.setup}${one.pass_number}.${one.place}:${one.deviation_um}${wordsOf(one.doubtful)}`).join()}`;
  if (key === drawn) return;
  drawn = key;
  curves ??= new Curves("deviations", { height: 230, counts: true, firstX: 1 });
  const labels = { columns: ["stop", ...columns(of)], xLabel: say("stop_axis"), yLabel: say("deviation_axis"), xRange: [1, Math.max(2, places)] };
  curves.draw(passes(of, places), `${say("deviations")}: ${setupName(last.setup)}`, labels);
}

// The frame stays the setup's own, also when its last stop is in and nothing more is awaited.
function frame(count, stops, setups) {
  const setup = setups.find(({ name }) => name === stops[0].setup);
  const own = setup ? Math.round(setup.stops_wanted / Math.max(1, setup.passes_wanted)) : count;
  return Math.max(own, ...stops.map(({ place }) => place + 1));
}

// Return the words of a stop: its setup, direction, number in its pass and deviation, and the reason of a doubt.
export function words({ setup, pass_number: pass, stop, deviation_um: deviation, doubtful }) {
  const sentence = say("last_stop", { setup: setupName(setup), way: wayOf(pass), stop: stop + 1, deviation: shown(deviation, 2) });
  return wordsOf(doubtful) ? `${sentence} (${say("doubtful", { reason: wordsOf(doubtful) })})` : sentence;
}

const passNumbers = (stops) => [...new Set(stops.map((one) => one.pass_number))].sort((a, b) => a - b);
const columns = (stops) => passNumbers(stops).flatMap((number) => [`pass_${number}_um`, `u_pass_${number}_um`]);

function passes(stops, count) {
  const numbers = passNumbers(stops);
  const x = Array.from({ length: count }, (_, index) => index + 1);
  return numbers.map((number) => {
    const y = Array(count).fill(null);
    const u = Array(count).fill(null);
    const odd = Array(count).fill(false);
    for (const one of stops.filter((stop) => stop.pass_number === number)) {
      y[one.place] = one.deviation_um;
      u[one.place] = Number.isFinite(one.u_um) ? one.u_um : 0;
      odd[one.place] = Boolean(wordsOf(one.doubtful));
    }
    return { label: say("pass_label", { number, way: wayOf(number) }), x, y, u, odd };
  });
}
