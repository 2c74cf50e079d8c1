// Recordings of this machine: to replay, to fetch, and to be reported on.
import { $, made, told, post, put } from "./dom.js";

const size = (bytes) => (bytes > 1e6 ? `${(bytes / 1e6).toFixed(1)} MB` : `${Math.ceil(bytes / 1e3)} kB`);
const at = (name, rest) => `api/runs/${encodeURIComponent(name)}/${rest}`;

export function runLinks(run, role) {
  const links = [made("a", { href: `?replay=${encodeURIComponent(run.name)}`, target: "_blank", rel: "noopener", textContent: "Replay", ariaLabel: `Replay ${run.name}` })];
  links.push(reportLink(run, role));
  for (const file of run.files) {
    links.push(made("a", { href: at(run.name, `files/${encodeURIComponent(file.name)}`), download: "", textContent: `${run.files.length > 1 ? file.name : "Download"} (${size(file.bytes)})`, ariaLabel: `Download ${file.name} of ${run.name}` }));
  }
  return links;
}

function reportLink(run, role) {
  const link = () => made("a", { href: at(run.name, "report"), target: "_blank", rel: "noopener", textContent: "Report", ariaLabel: `Report of ${run.name}` });
  if (run.report) return link();
  if (role !== "operator") return "";
  const button = made("button", { type: "button", className: "plain link", textContent: "Make report", ariaLabel: `Make the report of ${run.name}` });
  button.addEventListener("click", async () => {
    button.disabled = true;
    put(button, "being made …");
    const answer = await post("api/report", { run: run.name });
    const said = answer.ok ? await answer.json() : { ok: false, text: await answer.text() };
    if (said.ok) button.replaceWith(link());
    else { put(button, "no report"); button.title = said.text; }
  });
  return button;
}

function rowOf(run, role) {
  return made("tr", { dataset: { run: run.name } },
    made("td", { textContent: run.name }),
    made("td", { textContent: [run.trajectory, run.controller].filter(Boolean).join(", ") || (run.finished ? "–" : "being recorded") }),
    made("td", { textContent: run.mean_mm === undefined || run.mean_mm === null ? "–" : `${run.mean_mm.toFixed(2)} mm` }),
    made("td", { className: "links" }, ...runLinks(run, role)));
}

let rows = new Map();

// A row stays the same as long as it says the same: whoever has the focus in it, or waits for a report, keeps that.
export async function showRuns(role) {
  let runs;
  try { runs = (await told("api/runs")).slice(0, 60); } catch { return; }
  $("runspanel").hidden = !runs.length;
  const before = rows, table = $("runs");
  rows = new Map(runs.map((run) => {
    const words = JSON.stringify(run);
    return [words, before.get(words) || rowOf(run, role)];
  }));
  for (const [words, row] of before) if (!rows.has(words)) row.remove();
  [...rows.values()].forEach((row, n) => { if (table.children[n] !== row) table.insertBefore(row, table.children[n] || null); });
}
