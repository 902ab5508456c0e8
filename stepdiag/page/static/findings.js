// Findings grouped by cause (stepdiag/page/remarks.py), the newest cause first; what does not fit the screen is behind "all".

import { node, put } from "./draw.js";
import { common, language, say } from "./words.js";

const SHOWN = 3;

let drawn = "";

export function forget() {
  drawn = "";
}

export function open() {
  document.getElementById("all-findings").addEventListener("click", () => document.getElementById("all").showModal());
}

export function update({ findings }) {
  const key = JSON.stringify(findings);
  if (key === drawn) return;
  drawn = key;
  const loud = findings.filter(({ severity }) => severity !== "info");
  const few = (loud.length ? loud : findings).slice(0, SHOWN).map(item);
  document.getElementById("findings").replaceChildren(...(few.length ? few : [node("li", { class: "quiet" }, say("no_findings"))]));
  document.getElementById("all-list").replaceChildren(...findings.map(item));
  put("all-findings", say("all_findings", { count: findings.length })).hidden = findings.length <= few.length;
}

function item({ code, severity, said, advice, times }) {
  return node(
    "li",
    { class: `finding ${severity}` },
    node("strong", {}, common(`severity_${severity}`)),
    `: ${said[language].replace(/[^.!?]$/, "$&.")} `,
    ...(times > 1 ? [node("strong", {}, `×${times} `)] : []),
    node("span", { class: "quiet" }, advice[language]),
    " ",
    node("code", {}, code),
  );
}
