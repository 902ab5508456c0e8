// The result when the last setup is in: nine functions with their k=2 bands, squareness, scale, prediction, files.

import { chart } from "./chart.js";
import { lockedFiles } from "./commands.js";
import { node } from "./draw.js";
import { common, say, shown } from "./words.js";

const FUNCTIONS = ["EXX", "EYX", "EZX", "EXY", "EYY", "EZY", "EXZ", "EYZ", "EZZ"];
const UNITS = { um: "µm", urad: "µrad", "um/m": "µm/m" };
const LOOK_AGAIN_MS = 5000;

let state = "";
let looked = -Infinity;

export function forget() {
  state = "";
  looked = -Infinity;
}

export function update(snapshot) {
  const locked = lockedFiles();
  const key = `${snapshot.survey}|${snapshot.result_ready}|${JSON.stringify(snapshot.prediction)}|${locked}`;
  const now = performance.now();
  if (key !== state) {
    state = key;
    looked = -Infinity;
    if (snapshot.result_ready && !locked) fetchResult(snapshot.prediction);
    else show("result", node("p", { class: "quiet" }, say(snapshot.result_ready ? "files_locked" : "no_result")));
  }
  if (now - looked > LOOK_AGAIN_MS) {
    looked = now;
    if (locked) show("downloads", node("li", { class: "quiet" }, say("files_locked")));
    else fetchDownloads();
  }
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

async function fetchResult(prediction) {
  const result = await ask("/result.json");
  if (result === null) {
    state = "";
    return;
  }
  const pictures = FUNCTIONS.filter((name) => result.errors[name]?.value).map((name) => picture(name, result.errors[name]));
  const missing = FUNCTIONS.filter((name) => !result.errors[name]?.value);
  show(
    "result",
    ...(prediction ? [predicted(prediction)] : []),
    node("div", { class: "tables" }, table("squareness", result.squareness), table("scale", result.scale)),
    ...(missing.length ? [node("p", { class: "advice fair" }, `${common("not_identified")}: ${missing.join(", ")}`)] : []),
    node("div", { class: "pictures" }, ...pictures),
  );
}

function picture(name, { position_mm: x, value: y, u, unit, slope_identified: sloped }) {
  const options = { xRange: [x[0], x.at(-1)], xLabel: `${name[2]} / mm`, yLabel: `${name} / ${UNITS[unit]}`, label: name };
  return node("figure", {}, node("figcaption", {}, sloped ? name : say("shape_only", { name })), chart([{ label: name, x, y, u }], options));
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

function predicted({ rms_before_um: before, rms_after_um: after }) {
  const told = [`${say("before")} ${shown(before, 1)} µm`];
  if (after !== null) told.push(`${say("after")} ${shown(after, 1)} µm`);
  if (after) told.push(`${say("improvement")} ${shown(before / after, 1)}`);
  return node("p", { class: "prediction" }, node("strong", {}, say("volumetric")), `: ${told.join(" · ")}`);
}

async function fetchDownloads() {
  const files = await ask("/downloads.json");
  if (files === null) return;
  const items = files.map(({ name, kind, size_bytes: size, sha256 }) =>
    node(
      "li",
      {},
      node("a", { href: `/download/${encodeURIComponent(name)}`, ...(kind === "report" ? { target: "_blank", rel: "noopener" } : { download: name }) }, name),
      " ",
      node("small", { class: "quiet", title: sha256 ? `SHA-256 ${sha256}` : "" }, `${say(`kind_${kind}`)}, ${shown(size / 1024, 1)} KiB`),
    ),
  );
  show("downloads", ...(items.length ? items : [node("li", { class: "quiet" }, say("no_downloads"))]));
}
