// The numbers behind a figure as CSV, like those of the report: LF, decimal points, nine decimals, what is not known is empty.

import { node } from "./draw.js";

const DECIMALS = 9;

export function csv(columns, rows) {
  return [columns, ...rows].map((row) => `${row.map(cell).join(",")}\n`).join("");
}

function cell(value) {
  if (typeof value === "number") return Number.isFinite(value) ? String(Number(value.toFixed(DECIMALS)) + 0) : "";
  const text = value ?? "";
  return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

// Return a link that hands out, when it is followed, what a figure shows at that moment; table() says its columns and rows.
export function tableLink(name, table) {
  const file = `${name}.csv`;
  const link = node("a", { class: "csv", href: "#", download: file, "aria-label": file }, "CSV");
  link.addEventListener("click", () => {
    link.href = `data:text/csv;charset=utf-8,${encodeURIComponent(csv(...table()))}`;
  });
  return link;
}
