// What a person with the token may do. Without a token configured the page only shows.

import { node, put } from "./draw.js";
import { say, setupName, wordsOf } from "./words.js";

const CONFIRM_MS = 4000;

let token = sessionStorage.getItem("token") ?? "";
let filesLocked = false;
let ordering = false;
let options = "";
let armed = 0;
let latest = null;

const place = (id) => document.getElementById(id);

export function forget() {
  options = "";
  put("answer", place("unlock").hidden ? "" : say("locked"));
}

// Whether files are for those with the token, which has not been entered yet.
export const lockedFiles = () => filesLocked;

// Whether the viewer can give orders: the token has been entered.
export const mayOrder = () => ordering;

export function open(commandsExist) {
  if (!commandsExist) return;
  place("read-only").hidden = true;
  lock();
  submit("unlock", () => unlock(place("token").value));
  place("correct").addEventListener("click", () => order("correct", { name: place("operator").value || say("page_user") }));
  for (const name of ["start", "pause", "zero", "certificate", "take"]) place(name).addEventListener("click", () => order(name));
  place("abort").addEventListener("click", abort);
  place("more").addEventListener("click", () => place("more-orders").showModal());
  submit("choose", () => order("choose-setup", { setup: place("choose-setup").value }));
  submit("name", () => order("name", { operator: place("operator").value, workpiece: place("workpiece").value }));
  if (token) unlock(token);
}

function submit(id, act) {
  place(id).addEventListener("submit", (event) => {
    event.preventDefault();
    act();
  });
}

export function update(snapshot) {
  latest = snapshot;
  place("pause").hidden = snapshot.phase === "paused";
  place("start").hidden = snapshot.phase !== "paused" && !snapshot.begins;
  place("take").hidden = snapshot.recording || !snapshot.ahead.further;
  place("correct").hidden = snapshot.recording || !snapshot.corrects.length;
  put("correction", snapshot.corrects.length ? say("correction", { changes: snapshot.corrects.join("; ") }) : "");
  place("abort").disabled = !snapshot.recording;
  place("certificate").disabled = snapshot.phase !== "complete";
  for (const name of ["operator", "workpiece"]) {
    const field = place(name);
    if (document.activeElement !== field && field.dataset.known !== snapshot[name]) field.value = snapshot[name];
    field.dataset.known = snapshot[name];
  }
  const names = snapshot.setups.map((setup) => setup.name);
  if (names.join() === options) return;
  options = names.join();
  place("choose-setup").replaceChildren(...names.map((name) => node("option", { value: name }, setupName(name))));
}

// The stored token stays: the daemon has not refused it.
function lock(words = say("locked")) {
  filesLocked = true;
  ordering = false;
  place("unlock").hidden = false;
  place("orders").hidden = true;
  put("answer", words);
}

function discardToken() {
  token = "";
  sessionStorage.removeItem("token");
  return lock(say("wrong_token"));
}

function post(address, body, given = token) {
  const headers = { Authorization: `Bearer ${encodeURIComponent(given)}`, "Content-Type": "application/json" };
  return fetch(address, { method: "POST", headers, body: JSON.stringify(body) });
}

async function unlock(given) {
  const answer = await post("/access", {}, given).catch(() => null);
  if (answer === null) return put("answer", say("disconnected"));
  if (!answer.ok) return discardToken();
  token = given;
  filesLocked = false;
  ordering = true;
  sessionStorage.setItem("token", given);
  place("unlock").hidden = true;
  place("orders").hidden = false;
  place("token").value = "";
  return put("answer", "");
}

export async function order(name, given = {}) {
  const answer = await post("/command", { name, arguments: given }).catch(() => null);
  if (answer === null) return put("answer", say("disconnected"));
  if (answer.status === 403) return discardToken();
  if (answer.ok) return put("answer", say("done"));
  const { words } = await answer.json();
  return put("answer", say("refused", { why: wordsOf(words) }));
}

// Greasy hands press twice: the first press arms for four seconds.
function abort() {
  if (performance.now() < armed) {
    armed = 0;
    put("abort", say("abort"));
    return order("abort-setup");
  }
  armed = performance.now() + CONFIRM_MS;
  put("abort", say("confirm_abort", { setup: setupName(latest?.expects_setup ?? "") }));
  return setTimeout(() => armed && performance.now() >= armed && put("abort", say("abort")), CONFIRM_MS + 50);
}
