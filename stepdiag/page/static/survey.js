// How far the survey is: the setups, the time left, and the volume with the way being driven.

import { words } from "./deviations.js";
import { node, put } from "./draw.js";
import { Space } from "./space.js";
import { stopsTable, volume } from "./volume.js";
import { say, setupName, shown, wordsOf } from "./words.js";

let latest = null;
let drawn = "";
let space = null;

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
  const stops = snapshot.stops.map((one) => [one.position_mm, one.doubtful]);
  const key = JSON.stringify([snapshot.commanded_mm, snapshot.expects_setup, snapshot.expects_pass, stops, setups]);
  if (key === drawn || snapshot.stage === "done") return;
  drawn = key;
  document.getElementById("setups").replaceChildren(...setups.map(item));
  space ??= new Space(document.getElementById("volume"), "stops", draw, () => stopsTable(latest));
  space.redraw();
}

const draw = () => ({ label: say("volume_alt"), ...volume(latest, words) });

function left({ phase, seconds_left: seconds }) {
  if (phase === "complete") return "–";
  if (seconds === null) return say("time_unknown");
  const minutes = Math.ceil(seconds / 60);
  if (minutes < 2) return say("under_minute");
  return minutes < 90 ? say("minutes", { minutes }) : say("hours", { hours: shown(minutes / 60, 1) });
}

function item({ name, state, reason, passes_done: done, passes_wanted: wanted, stops_done: stops, stops_wanted: all }) {
  const why = wordsOf(reason);
  return node(
    "li",
    { class: `setup ${state}`, title: why },
    node("strong", {}, setupName(name)),
    " ",
    node("span", { class: "chip" }, say(`state_${state.replaceAll("-", "_")}`)),
    node("small", {}, `${say("passes", { done, wanted })} · ${stops} / ${all}${why ? ` · ${why}` : ""}`),
  );
}
