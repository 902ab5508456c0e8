// Findings as they arise, in the solver's words, with what to do about them.

import { node } from "./draw.js";
import { advice, common, say } from "./words.js";

let drawn = "";

export function forget() {
  drawn = "";
}

export function update({ findings }) {
  const key = JSON.stringify(findings);
  if (key === drawn) return;
  drawn = key;
  const items = counted(findings).map(item);
  document.getElementById("findings").replaceChildren(...(items.length ? items : [node("li", { class: "quiet" }, say("no_findings"))]));
}

// Return each finding once with how often it was said, the latest first: a laser that complains in every pass fills no screen.
function counted(findings) {
  const known = new Map();
  for (const one of findings) {
    const key = `${one.code} ${one.text}`;
    const times = (known.get(key)?.times ?? 0) + 1;
    known.delete(key);
    known.set(key, { ...one, times });
  }
  return [...known.values()].reverse();
}

function item({ code, severity, text, times }) {
  return node(
    "li",
    { class: `finding ${severity}` },
    node("strong", {}, common(`severity_${severity}`)),
    `: ${text} `,
    ...(times > 1 ? [node("strong", {}, `×${times} `)] : []),
    node("span", { class: "quiet" }, advice(code)),
    " ",
    node("code", {}, code),
  );
}
