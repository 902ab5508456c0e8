// How far the survey is: the volume, the setups, the time left.

import { node, put } from "./draw.js";
import { turnable, volume } from "./volume.js";
import { say, setupName, shown } from "./words.js";

let latest = null;
let drawn = "";
let turns = false;

export function forget() {
  drawn = "";
}

export function update(snapshot) {
  latest = snapshot;
  const { setups } = snapshot;
  const done = setups.reduce((sum, setup) => sum + setup.stops_done, 0);
  const wanted = setups.reduce((sum, setup) => sum + setup.stops_wanted, 0);
  const bar = document.getElementById("progress");
  bar.max = wanted || 1;
  bar.value = done;
  put("progress-words", `${done} / ${wanted}`);
  put("time-left", left(snapshot));
  const key = JSON.stringify([snapshot.commanded_mm, snapshot.expects_setup, snapshot.stops.length, setups, snapshot.size_mm]);
  if (key === drawn) return;
  drawn = key;
  document.getElementById("setups").replaceChildren(...setups.map(item));
  draw();
}

function draw() {
  const place = document.getElementById("volume");
  place.replaceChildren(volume(latest, say("volume_alt")));
  place.setAttribute("role", "group");
  place.setAttribute("aria-label", say("volume_alt"));
  if (!turns) turnable(place, draw);
  turns = true;
}

function left({ phase, seconds_left: seconds }) {
  if (phase === "complete") return "–";
  if (seconds === null) return say("time_unknown");
  return seconds < 60 ? say("under_minute") : say("minutes", { minutes: shown(Math.ceil(seconds / 60), 0) });
}

function item({ name, state, reason, passes_done: done, passes_wanted: wanted, stops_done: stops, stops_wanted: all }) {
  const words = state.replaceAll("-", "_");
  return node(
    "li",
    { class: `setup ${state}` },
    node("strong", {}, setupName(name)),
    " ",
    node("span", { class: "chip" }, say(`state_${words}`)),
    node("small", {}, `${say("passes", { done, wanted })} · ${stops} / ${all}${reason ? ` · ${reason}` : ""}`),
  );
}
