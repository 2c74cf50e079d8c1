// The event log: filtered, copied, and in a replay a way to the moment of each.
import { $, made } from "./dom.js";

const KEPT = 1000, SHOWN = 200;
let events = [], jump = null, now = Infinity;

const text = (event) => `${event.subject ? `${event.subject}: ` : ""}${event.present ? "" : "over: "}${event.text}${event.detail ? ` (${event.detail})` : ""}`;
const seconds = (event) => event.t_s ?? event.t_ns * 1e-9;
const identity = (event) => `${event.sequence} ${event.t_ns}`;
const line = (event) => `${seconds(event).toFixed(3)}\t${event.kind}\t${event.name}\t${text(event)}`;

export const eventCount = () => events.length;

// A connection that has come back tells from the beginning.
export function addEvents(told) {
  const known = new Set(jump ? [] : events.map(identity));
  events = events.concat(told.filter((event) => !known.has(identity(event))));
  if (!jump) events = events.slice(-KEPT);
  show();
}

export function clearEvents() { events = []; show(); }

// In a replay: each event is pressed to go to its moment.
export function eventsJump(to) { jump = to; }

export function eventsAt(t) {
  now = t;
  let current = null;
  for (const row of $("events").children) {
    const later = Number(row.dataset.t) > t + 1e-6;
    row.classList.toggle("later", later);
    if (!later && !current) current = row;
  }
  for (const row of $("events").children) row.classList.toggle("current", row === current);
  if (current) {
    const list = $("events"), top = current.offsetTop - list.offsetTop;
    if (top < list.scrollTop || top + current.offsetHeight > list.scrollTop + list.clientHeight) list.scrollTop = Math.max(0, top - list.clientHeight / 2);
  }
}

export function neighbour(t, way) {
  const times = events.map(seconds);
  return way > 0 ? times.find((time) => time > t + 1e-3) : times.findLast((time) => time < t - 1e-3);
}

function show() {
  const wanted = $("filter").value.toLowerCase();
  const found = events.filter((event) => !wanted || `${event.kind} ${event.name} ${text(event)}`.toLowerCase().includes(wanted));
  const rows = found.slice(jump ? -2000 : -SHOWN).reverse(), left = found.length - rows.length;
  $("events").replaceChildren(...rows.map((event) => {
    const t = seconds(event);
    const what = jump ? made("button", { type: "button", className: "plain", textContent: text(event), title: "go to this moment" }) : made("span", { textContent: text(event) });
    if (jump) what.addEventListener("click", () => jump(t));
    return made("li", { dataset: { t, severity: event.severity || "" } }, made("time", { textContent: `${t.toFixed(2)} s` }), made("span", { className: "kind", textContent: event.kind }), what);
  }));
  if (left) $("events").append(made("li", { dataset: { t: -Infinity } }, made("span"), made("span"), made("span", { textContent: `${left} earlier ones are not listed: filter for them, or copy all` })));
  if (jump) eventsAt(now);
}

async function copy() {
  const lines = events.map(line).join("\n");
  try {
    await navigator.clipboard.writeText(lines);
  } catch {  // not everywhere is a page allowed to: then by hand
    const area = made("textarea", { value: lines, ariaLabel: "Events as text" });
    document.body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
  $("copy").textContent = "Copied";
  setTimeout(() => { $("copy").textContent = "Copy"; }, 1500);
}

$("filter").addEventListener("input", show);
$("copy").addEventListener("click", copy);
