// What happens now: reading, beam, state in words, links, air; and what the person has to do next.

import { node, put } from "./draw.js";
import { say, setupName, shown } from "./words.js";

const WEAK = 0.4; // below this share of full strength a stop may be lost to dust or chips
const LINKS = ["laser", "plc", "head"];
const GONE = new Set(["silent", "lost"]);

let linked = "";

export function forget() {
  linked = "";
}

export function update(snapshot) {
  put("phase", phaseWords(snapshot)).classList.toggle("bad", snapshot.phase === "failed");
  put("message", [snapshot.message, snapshot.alarm ? say("alarm") : "", running(snapshot) && !snapshot.recording ? say("not_recording") : ""].filter(Boolean).join(" "));
  put("reading", shown(snapshot.reading_mm, 5));
  beam(snapshot);
  links(snapshot);
  put("air", shown(snapshot.air_temperature_c, 2, "°C"));
  put("material", shown(snapshot.material_temperature_c, 2, "°C"));
  put("pressure", shown(snapshot.air_pressure_hpa, 1, "hPa"));
  put("humidity", shown(snapshot.relative_humidity_percent, 0, "%"));
  put("instruction", instruction(snapshot));
}

const running = ({ phase }) => phase === "waiting-stop" || phase === "dwelling";

function phaseWords(snapshot) {
  const { phase, moving_axis: axis } = snapshot;
  const values = {
    setup: setupName(snapshot.expects_setup),
    stop: snapshot.expects_stop,
    last: snapshot.stops_in_pass - 1,
    axis: axis.toUpperCase(),
  };
  return say(phase === "waiting-stop" && !axis ? "phase_waiting_stop_plain" : `phase_${phase.replaceAll("-", "_")}`, values);
}

function beam({ beam: strength, beam_lost: lost }) {
  const share = strength === null ? 0 : Math.min(1, Math.max(0, strength));
  const meter = document.getElementById("beam-meter");
  const words = say(lost ? "beam_lost" : strength === null ? "beam_unknown" : share < WEAK ? "beam_weak" : "beam_good");
  const told = strength === null ? words : `${shown(100 * share, 0)} % ${words}`;
  meter.setAttribute("aria-valuenow", (100 * share).toFixed(0));
  meter.setAttribute("aria-valuetext", told);
  meter.setAttribute("aria-label", say("beam"));
  meter.className = `meter ${lost ? "bad" : share < WEAK ? "weak" : "good"}`;
  document.getElementById("beam-fill").style.width = `${100 * share}%`;
  put("beam-words", told);
}

function links(snapshot) {
  const present = LINKS.filter((name) => snapshot[name]);
  const key = present.map((name) => `${name}${snapshot[name].address}${snapshot[name].detail}`).join("|");
  if (key === linked) return;
  linked = key;
  const items = present.map((name) => {
    const { address, detail } = snapshot[name];
    const where = detail.startsWith(address) ? detail : [address, detail].filter(Boolean).join(", ");
    return node("li", { "data-link": name, class: "chip" }, node("strong", {}, say(name)), " ", node("span", { class: "state" }), node("small", {}, where));
  });
  document.getElementById("links").replaceChildren(...items);
}

// Return what the person has to do: what blocks the survey first, then the next hand on the set-up.
function instruction(snapshot) {
  const { phase, expects_setup: setup, laser, plc } = snapshot;
  if (GONE.has(laser.state)) return say("do_laser");
  if (GONE.has(plc.state)) return say("do_plc");
  if (running(snapshot)) return say(snapshot.beam_lost ? "do_beam" : "do_running"); // before a pass the laser is being turned
  return phase === "waiting-program" ? setUp(setup, snapshot.program) : say(`do_${phase}`);
}

function setUp(setup, named) {
  const program = named || say("program_of", { setup });
  const [base] = setup.split("+");
  const [kind, axis] = base.split("-");
  if (axis) return say(`do_${kind}`, { axis: axis.toUpperCase(), program });
  const corner = [...base].map((sign, index) => `${"XYZ"[index]} ${say(sign === "p" ? "corner_low" : "corner_high")}`).join(", ");
  return say("do_body", { setup, corner, program });
}
