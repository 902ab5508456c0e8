// The words of the page in the language chosen, and numbers written as that language writes them.

let texts = { common: {}, page: {}, finding: {} };
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

export const common = (key) => texts.common[key] ?? key;
export const advice = (code) => texts.finding[code] ?? "";

// Return a number with a fixed count of decimals and a true minus sign; a dash where there is none.
export function shown(value, decimals, unit = "") {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const digits = { minimumFractionDigits: decimals, maximumFractionDigits: decimals, useGrouping: false };
  const text = new Intl.NumberFormat(language, digits).format(value).replace("-", "−");
  return unit ? `${text} ${unit}` : text;
}

export function setupName(setup) {
  const [base, offset] = setup.split("+");
  const [kind, axis] = base.split("-");
  const name = axis ? say(`setup_${kind}`, { axis: axis.toUpperCase() }) : say(`setup_${base}`);
  return offset ? `${name} +${offset}` : name;
}
