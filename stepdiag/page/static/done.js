// When the last setup is in: the conclusion, the volume before and after, squareness and functions with their U.

import { lockedFiles } from "./commands.js";
import { Curves } from "./curves.js";
import { node } from "./draw.js";
import { field } from "./field.js";
import { common, say, shown, wordsOf } from "./words.js";

const FUNCTIONS = ["EXX", "EYX", "EZX", "EXY", "EYY", "EZY", "EXZ", "EYZ", "EZZ"];
const UNITS = { um: "µm", urad: "µrad", "um/m": "µm/m" };
const SECTIONS = ["verdict", "wrong", "unknown", "load", "basis"];

let state = "";
let next = null;

export function forget() {
  state = "";
}

// The conclusion's next step in the language chosen: the one sentence that matters once all is done; empty before it is known.
export const nextStep = () => (next ? next.map((one) => wordsOf(one)).join(" ") : "");

export function update({ survey, result_ready: ready, stage, geometry }) {
  const locked = lockedFiles();
  const key = `${survey}|${ready}|${stage}|${locked}`;
  if (key === state) return;
  state = key;
  next = null;
  if (stage !== "done") return undefined;
  if (ready) return fetchAll(geometry, locked);
  show("conclusion", node("p", { class: "quiet" }, say("no_result")));
  return undefined;
}

function show(id, ...children) {
  document.getElementById(id).replaceChildren(...children);
}

// Ask the daemon; null where it has nothing or is away, which the page shows elsewhere.
async function ask(address) {
  try {
    const answer = await fetch(address);
    return answer.ok ? await answer.json() : null;
  } catch {
    return null;
  }
}

// The conclusion is words, which are open to whoever sees the page; the result is a file.
async function fetchAll(geometry, locked) {
  const [concluded, result] = await Promise.all([ask("/conclusion.json"), locked ? null : ask("/result.json")]);
  if (concluded) conclusion(concluded, geometry);
  else show("conclusion", node("p", { class: "quiet" }, say("no_conclusion")));
  if (result) figures(result);
  else if (locked) show("result", node("p", { class: "quiet" }, say("files_locked")));
  else state = "";
}

function conclusion(document_, geometry) {
  const words = (section) => (document_[section] || []).map((one) => wordsOf(one));
  const list = (section) => (words(section).length ? [node("h3", {}, say(`conclusion_${section}`)), node("ul", { class: section }, ...words(section).map((one) => node("li", {}, one)))] : []);
  next = document_.next_step;
  // the verdict of a proof run stands at the head, and states nothing about the machine's errors
  const verdictAlone = !["reached", ...SECTIONS].some((section) => words(section).length);
  for (const id of ["conclusion", "field", "result"]) document.getElementById(id).closest("section").hidden = verdictAlone;
  show(
    "conclusion",
    node("ul", { class: "reached" }, ...words("reached").map((one) => node("li", {}, one))),
    ...SECTIONS.flatMap(list),
  );
  const place = document.getElementById("field");
  document.getElementById("h-field").textContent = say(document_.field && !document_.field.after_um ? "volumetric_found" : "volumetric");
  if (document_.field) field(place, document_.field, geometry);
  else place.replaceChildren();
}

function figures(result) {
  const known = FUNCTIONS.filter((name) => result.errors[name]?.value);
  const missing = FUNCTIONS.filter((name) => !result.errors[name]?.value);
  show(
    "result",
    node("div", { class: "tables" }, table("squareness", result.squareness), table("scale", result.scale)),
    ...(missing.length ? [node("p", { class: "note fair" }, `${common("not_identified")}: ${missing.join(", ")}`)] : []),
    node("div", { class: "pictures" }, ...known.map((name) => holder(name, result.errors[name]))),
  );
  for (const name of known) curve(name, result.errors[name]);
}

const holder = (name, { slope_identified: sloped }) =>
  node("figure", {}, node("figcaption", {}, sloped ? name : say("shape_only", { name })), node("div", { class: "curve", id: `function-${name}` }));

function curve(name, { position_mm: x, value: y, u, unit }) {
  const columns = [`${name[2].toLowerCase()}_mm`, `${name}_${unit}`, `u_${unit}`];
  const curves = new Curves(`function-${name}`, { columns, height: 180, xLabel: `${name[2]} / mm`, yLabel: `${name} / ${UNITS[unit]}`, xRange: [x[0], x.at(-1)] });
  curves.draw([{ label: name, x, y, u }], name);
}

function table(kind, quantities) {
  const rows = Object.entries(quantities).map(([name, { value, u, unit }]) =>
    node(
      "tr",
      {},
      node("th", { scope: "row" }, name),
      node("td", {}, value === null ? common("not_identified") : `${shown(value, 1)} ± ${shown(u === null ? null : 2 * u, 1)} ${UNITS[unit]}`),
    ),
  );
  return node("table", {}, node("caption", {}, `${say(kind)}, ${common("expanded")}`), node("tbody", {}, ...rows));
}
