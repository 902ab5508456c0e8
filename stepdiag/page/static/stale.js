// Marks everything that is old: by the age the daemon gives plus the time since it was last heard.

import { STALE_MS } from "./stream.js";
import { common, say, shown } from "./words.js";

const STALE_S = STALE_MS / 1000;

// Return the age of a source in seconds; null where it never sent anything.
export function age(source, snapshot, silence) {
  if (source === "daemon") return silence;
  const link = snapshot[source];
  return link === null || link.age_s === null ? null : link.age_s + silence;
}

export function ageText(seconds) {
  if (seconds === null) return say("never");
  return say("stale", { seconds: shown(seconds, seconds < 10 ? 1 : 0) });
}

export function mark(snapshot, silence) {
  for (const place of document.querySelectorAll("[data-source]")) {
    const seconds = age(place.dataset.source, snapshot, silence);
    const old = seconds === null || seconds > STALE_S;
    place.classList.toggle("stale", old);
    const label = place.querySelector(".age");
    if (label) label.textContent = old ? ageText(seconds) : "";
  }
  for (const place of document.querySelectorAll("[data-link]")) {
    const seconds = age(place.dataset.link, snapshot, silence);
    const state = snapshot[place.dataset.link]?.state ?? "lost";
    const live = state === "connected" && seconds !== null && seconds <= STALE_S;
    place.classList.toggle("good", live);
    place.classList.toggle("bad", !live);
    const shownState = state === "connected" && !live ? "silent" : state;
    const words = silence > STALE_S ? common("unknown") : say(`link_${shownState}`);
    const text = live || seconds === null ? words : `${words}, ${ageText(seconds)}`;
    const label = place.querySelector(".state");
    if (label.textContent !== text) label.textContent = text;
  }
}
