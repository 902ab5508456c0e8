// Boots the page: words, live stream, panels. Every panel is a module with update(snapshot, kind).

import * as aid from "./aid.js";
import * as commands from "./commands.js";
import * as deviations from "./deviations.js";
import * as done from "./done.js";
import * as files from "./files.js";
import * as findings from "./findings.js";
import * as lead from "./lead.js";
import * as reading from "./reading.js";
import * as stale from "./stale.js";
import * as strip from "./strip.js";
import * as survey from "./survey.js";
import { put } from "./draw.js";
import { Stream } from "./stream.js";
import { language, loadTexts, nameSetups, say } from "./words.js";

const PANELS = [lead, reading, strip, aid, deviations, survey, findings, done, files, commands];
const LOOK_MS = 100;
const snapshot = {};
let unshut = [];

function head() {
  put("machine", snapshot.machine || "stepdiag");
  put("survey-name", snapshot.survey ?? "");
  put("people", [snapshot.operator, snapshot.workpiece].filter(Boolean).join(" · "));
}

function whole() {
  return "sequence" in snapshot && "setups" in snapshot;
}

function update(kind) {
  if (!whole()) return;
  nameSetups(snapshot.setups);
  head();
  for (const panel of PANELS) panel.update(snapshot, kind);
}

async function speak(wanted) {
  await loadTexts(wanted);
  localStorage.setItem("language", wanted);
  for (const panel of PANELS) panel.forget?.();
  walls();
  update("survey");
}

function theme(wanted) {
  document.documentElement.dataset.theme = wanted;
  localStorage.setItem("theme", wanted);
  for (const panel of PANELS) panel.forget?.();
  update("survey");
}

function dark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
}

async function about() {
  const answer = await fetch("/about.json");
  return answer.json();
}

// What the kernel of this computer could not shut for the page's process.
function walls() {
  document.getElementById("open").hidden = !unshut.length;
  put("open", say("not_walled", { what: unshut.map((one) => say(`open_${one.toLowerCase().replaceAll(" ", "_")}`)).join(", ") }));
}

async function boot() {
  const facts = await about();
  unshut = facts.open;
  const chosen = localStorage.getItem("theme");
  if (chosen) document.documentElement.dataset.theme = chosen;
  const remembered = localStorage.getItem("language");
  await loadTexts(facts.languages.includes(remembered) ? remembered : facts.language);
  walls();
  document.getElementById("theme").addEventListener("click", () => theme(dark() ? "light" : "dark"));
  const other = () => facts.languages.find((one) => one !== language);
  document.getElementById("language").addEventListener("click", () => speak(other()));
  lead.open();
  findings.open();
  commands.open(facts.commands);
  const stream = new Stream((kind, news) => {
    Object.assign(snapshot, news);
    update(kind);
  });
  setInterval(() => look(stream), LOOK_MS);
}

// Show what is old as old, ten times a second, whether or not anything arrives.
function look(stream) {
  const away = !stream.live && whole();
  document.getElementById("offline").hidden = !away;
  document.body.classList.toggle("away", away);
  const chip = put("connection", say(stream.live ? "connected" : "link_connecting"));
  chip.classList.toggle("good", stream.live);
  if (whole()) stale.mark(snapshot, stream.age / 1000);
}

boot();
