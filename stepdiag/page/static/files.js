// What may be fetched: one bundle a control with its steps, restore apart; single files and logs behind "all files".

import { lockedFiles } from "./commands.js";
import { node } from "./draw.js";
import { say, shown } from "./words.js";

const LOOK_AGAIN_MS = 5000;

let looked = -Infinity;

export function forget() {
  looked = -Infinity;
}

export function update({ stage }) {
  const now = performance.now();
  if (stage !== "done" || now - looked < LOOK_AGAIN_MS) return;
  looked = now;
  if (!lockedFiles()) list();
}

async function ask(address) {
  try {
    const answer = await fetch(address);
    return answer.ok ? await answer.json() : null;
  } catch {
    return null;
  }
}

async function list() {
  const files = await ask("/downloads.json");
  if (files === null) return;
  const report = files.filter(({ kind }) => kind === "report" || kind === "certificate");
  const bundles = files.filter(({ kind }) => kind === "bundle" || kind === "restore");
  const controls = [...new Set(bundles.map(({ group }) => group))];
  const place = document.getElementById("bundles");
  place.replaceChildren(...report.map((one) => node("p", {}, link(one))), ...controls.map((control) => bundle(control, bundles.filter(({ group }) => group === control), files.some((one) => untested(one, control)))));
  const items = files.filter(({ kind }) => kind !== "bundle" && kind !== "restore").map((one) => node("li", {}, link(one), " ", about(one)));
  document.getElementById("downloads").replaceChildren(...(items.length ? items : [node("li", { class: "quiet" }, say("no_downloads"))]));
}

// A table whose sign nobody tried on this machine says so in its name.
const untested = ({ kind, name }, control) => kind === "export" && name.startsWith(`exports-${control}-`) && name.includes("_UNTESTED_SIGN");

function bundle(control, files, trySign) {
  const steps = [...(trySign ? ["step_sign_test"] : []), "step_load", "step_measure"].map((step) => node("li", {}, say(step, { control })));
  return node(
    "div",
    { class: "bundle" },
    node("h3", {}, control),
    node("ol", { class: "steps" }, ...steps),
    node("p", { class: "buttons" }, ...files.map((one) => node("a", { class: `button ${one.kind}`, href: href(one), download: one.name }, say(`kind_${one.kind}`, { control })))),
  );
}

const href = ({ name }) => `/download/${encodeURIComponent(name)}`;

function link(one) {
  const how = one.kind === "report" ? { target: "_blank", rel: "noopener" } : { download: one.name };
  return node("a", { href: href(one), ...how }, one.kind === "report" ? say("open_report") : one.name);
}

const about = ({ kind, size_bytes: size, sha256 }) =>
  node("small", { class: "quiet", title: sha256 ? `SHA-256 ${sha256}` : "" }, `${say(`kind_${kind}`)}, ${shown(size / 1024, 1)} KiB`);
