// The reading, the beam, the links and the air.

import { node, put } from "./draw.js";
import { say, shown, wordsOf } from "./words.js";

const WEAK = 0.4; // as in stepdiag/page/stage.py
const LINKS = ["laser", "plc", "head", "air"];

let linked = "";

export function forget() {
  linked = "";
}

export function update(snapshot) {
  put("reading", shown(snapshot.reading_mm, 5));
  beam(snapshot);
  links(snapshot);
  put("air", shown(snapshot.air_temperature_c, 2, "°C"));
  put("material", shown(snapshot.material_temperature_c, 2, "°C"));
  put("pressure", shown(snapshot.air_pressure_hpa, 1, "hPa"));
  put("humidity", shown(snapshot.relative_humidity_percent, 0, "%"));
}

// An instrument that reports no strength says so: an empty bar would be a lie.
function beam({ beam: strength, beam_lost: lost }) {
  const unknown = strength === null && !lost;
  document.getElementById("no-beam").hidden = !unknown;
  document.querySelector(".beam").hidden = unknown;
  const share = strength === null || lost ? 0 : Math.min(1, Math.max(0, strength));
  const words = say(lost ? "beam_lost" : share < WEAK ? "beam_weak" : "beam_good");
  const strengthText = strength === null || lost ? words : `${shown(100 * share, 0)} % ${words}`;
  const meter = document.getElementById("beam-meter");
  meter.setAttribute("aria-valuenow", (100 * share).toFixed(0));
  meter.setAttribute("aria-valuetext", strengthText);
  meter.setAttribute("aria-label", say("beam"));
  meter.className = `meter ${lost ? "bad" : share < WEAK ? "weak" : "good"}`;
  document.getElementById("beam-fill").style.width = `${100 * share}%`;
  put("beam-words", strengthText);
}

function links(snapshot) {
  const present = LINKS.filter((name) => snapshot[name]);
  const key = present.map((name) => `${name}${snapshot[name].address}${wordsOf(snapshot[name].detail)}`).join("|");
  if (key === linked) return;
  linked = key;
  const items = present.map((name) => {
    const { address, detail } = snapshot[name];
    const named = detail?.en?.startsWith(address); // in the daemon's own words
    const where = (named ? [wordsOf(detail)] : [address, wordsOf(detail)]).filter(Boolean).join(", ");
    return node("li", { "data-link": name, class: "chip" }, node("strong", {}, say(name)), " ", node("span", { class: "state" }), node("small", {}, where));
  });
  document.getElementById("links").replaceChildren(...items);
}
