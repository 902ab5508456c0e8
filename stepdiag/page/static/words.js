// The words of the page in the language chosen, and numbers written as that language writes them.

let texts = { common: {}, page: {} };
export let language = "en";

export async function loadTexts(wanted) {
  const answer = await fetch(`/texts/${wanted}.json`);
  if (!answer.ok) throw new Error(`texts ${wanted}: ${answer.status}`);
  texts = await answer.json();
  language = wanted;
  document.documentElement.lang = wanted;
  for (const place of document.querySelectorAll("[data-text]")) place.textContent = say(place.dataset.text);
}

// Return a text of the page with its {names} filled in.
export function say(key, values = {}) {
  return (texts.page[key] ?? key).replace(/\{(\w+)\}/g, (whole, name) => values[name] ?? whole);
}

// Return the words of a sentence of the daemon: its key and values, which may be sentences themselves; a setup gets its name.
export function sentence({ key, values }) {
  const known = Object.entries(values).map(([name, value]) => [name, filled(name, value)]);
  return say(key, Object.fromEntries(known));
}

function filled(name, value) {
  if (Array.isArray(value)) return value.map(sentence).join(", ");
  return name === "setup" ? setupName(value) : value;
}

const CORNER = /(?:[XYZ][+-]){2,3}(?!\w)/g;

// Return the words of the daemon in the chosen language, corners with true minus signs: no line ends there.
export const wordsOf = (both) => (both?.[language] ?? "").replace(CORNER, (corner) => corner.replaceAll("-", "−"));

export const common = (key) => texts.common[key] ?? key;

// Return a number with a fixed count of decimals and a true minus sign; a dash where there is none.
export function shown(value, decimals, unit = "") {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const digits = { minimumFractionDigits: decimals, maximumFractionDigits: decimals, useGrouping: false };
  const text = new Intl.NumberFormat(language, digits).format(value).replace(/^-(?=[0.,]*$)/, "").replace("-", "−");
  return unit ? `${text} ${unit}` : text;
}

let names = {};

// Take the words of the setups from the daemon: a diagonal by its corners, the short name beside them.
export function nameSetups(setups) {
  names = Object.fromEntries(setups.map(({ name, words }) => [name, words]));
}

export const setupName = (setup) => wordsOf(names[setup]) || setup;

// Return the direction of a pass: odd passes lead outward.
export const wayOf = (pass) => say(pass % 2 === 1 ? "outward" : "return");
