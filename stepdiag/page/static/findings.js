// Findings grouped by cause (stepdiag/page/remarks.py), errors first; what does not fit the screen is behind "all".

import { mayOrder, order } from "./commands.js";
import { node, put } from "./draw.js";
import { common, say, wordsOf } from "./words.js";

const SHOWN = 3;

let drawn = "";

export function forget() {
  drawn = "";
}

export function open() {
  document.getElementById("all-findings").addEventListener("click", () => document.getElementById("all").showModal());
  document.getElementById("accept").addEventListener("submit", (event) => {
    event.preventDefault();
    const given = Object.fromEntries(["name", "reason"].map((field) => [field, document.getElementById(`accept-${field}`).value]));
    document.getElementById("accept").hidden = true;
    order("accept", { place: document.getElementById("accept-place").dataset.place, ...given });
  });
}

function ask(place, words) {
  document.getElementById("accept").hidden = false;
  document.getElementById("accept-place").value = words;
  document.getElementById("accept-place").dataset.place = place;
  document.getElementById("accept-reason").focus();
}

export function update({ findings }) {
  const key = JSON.stringify([findings, mayOrder()]);
  if (key === drawn) return;
  drawn = key;
  const open = findings.filter(({ state }) => state === "open");
  const loud = open.length ? open : findings.filter(({ severity, state }) => severity !== "info" && state !== "accepted");
  const few = (loud.length ? loud : findings).slice(0, SHOWN).map((one) => item(one));
  document.getElementById("findings").replaceChildren(...(few.length ? few : [node("li", { class: "quiet" }, say("no_findings"))]));
  document.getElementById("all-list").replaceChildren(...findings.map((one) => item(one, true)));
  put("all-findings", say("all_findings", { count: findings.length })).hidden = findings.length <= few.length && !open.length;
}

// A doubt that keeps its pass open can be accepted by a person with the token, who gives the reason: at a place, or by its code at all.
function item({ code, severity, sentence, advice, times, state, places, word }, whole = false) {
  const named = Object.entries(places).map(([place, words]) => [place, wordsOf(words) || place]);
  const taken = named.length > 1 ? [[code, code], ...named] : named;
  const accept = whole && mayOrder() && state === "open" ? taken.map(([place, words]) => button(place, words)) : [];
  return node(
    "li",
    { class: `finding ${severity} state-${state}` },
    node("strong", {}, common(`severity_${severity}`)),
    `: ${wordsOf(sentence).replace(/[^.!?]$/, "$&.")} `,
    ...(times > 1 ? [node("strong", {}, `×${times} `)] : []),
    node("span", { class: "quiet" }, wordsOf(advice)),
    " ",
    node("code", {}, code),
    ...(word ? [node("p", {}, say("accepted_by", { word }))] : []),
    ...accept,
  );
}

function button(place, words) {
  const one = node("button", { type: "button", class: "accept" }, say("accept_place", { place: words }));
  one.addEventListener("click", () => ask(place, words));
  return one;
}
