// The big card: the stage, the one sentence that matters, what to do about it; and the alarm in title, frame, text and sound.

import { mayOrder } from "./commands.js";
import { nextStep } from "./done.js";
import { node, put } from "./draw.js";
import { say, sentence, wordsOf } from "./words.js";

const STAGES = ["set-up", "align", "drive", "done"];
const BEEP_S = 0.25;
const EVERY_MS = 2000;

let audio = null;
let alarmed = false;
let drawn = "";

export function forget() {
  drawn = "";
  button();
}

// Sound is a person's choice, remembered; a browser plays none before a first touch.
export function open() {
  const sound = document.getElementById("sound");
  sound.addEventListener("click", () => {
    localStorage.setItem("sound", wanted() ? "off" : "on");
    if (wanted()) beep();
    button();
  });
  setInterval(() => alarmed && wanted() && beep(), EVERY_MS);
  button();
}

const wanted = () => localStorage.getItem("sound") !== "off";

function button() {
  put("sound", say(wanted() ? "sound_on" : "sound_off")).setAttribute("aria-pressed", String(wanted()));
}

function beep() {
  audio ??= new AudioContext();
  if (audio.state !== "running") return void audio.resume();
  const tone = audio.createOscillator();
  const loud = audio.createGain();
  tone.frequency.value = 880;
  loud.gain.value = 0.2;
  tone.connect(loud).connect(audio.destination);
  tone.start();
  tone.stop(audio.currentTime + BEEP_S);
}

export function update(snapshot) {
  const { stage, alarm, proof, lead, advice, watching, message, machine, ahead } = snapshot;
  alarmed = alarm;
  document.body.dataset.stage = stage;
  document.body.dataset.proof = proof ?? "";
  document.body.classList.toggle("alarm", alarm);
  const words = sentence(lead);
  put("lead", words);
  const next = stage === "done" ? nextStep() : "";
  put("advice", next ? `${say("conclusion_next_step")}: ${next}` : sentence(mayOrder() ? advice : watching));
  put("ahead", wordsOf(ahead.words));
  put("message", wordsOf(message));
  document.title = `${alarm ? `⚠ ${say("alarm_word")}: ` : ""}${words} – ${machine}`;
  stages(stage);
}

function stages(stage) {
  if (stage === drawn) return;
  if (drawn) document.querySelector("main").scrollTo(0, 0); // what matters now stands at the top, wherever a person was reading
  drawn = stage;
  const items = STAGES.map((one) => {
    const current = one === stage || (stage === "trouble" && one === "drive");
    return node("li", { class: current ? "current" : "", ...(current ? { "aria-current": "step" } : {}) }, say(`stage_${one.replace("-", "_")}`));
  });
  if (stage === "trouble") items.push(node("li", { class: "current bad" }, `⚠ ${say("stage_trouble")}`));
  document.getElementById("stages").replaceChildren(...items);
}
