// What is told of a robot's state, in words and figures: the same whether it is live or replayed.
import { $, put, number, made } from "./dom.js";

const MOODS = { running: "good", armed: "on", ready: "on", homing: "on", hold: "warn", fault: "bad", estop: "bad" };
const KEPT = {};

// Drawn anew only where it says something else.
function changed(name, value) {
  const key = JSON.stringify(value);
  if (KEPT[name] === key) return false;
  KEPT[name] = key;
  return true;
}

// Where along the body it gives way, what room is left there, and what that takes from the tip's step.
function aside(risk) {
  if (!risk || !Number.isFinite(risk.aside_clearance_mm)) return "";
  const where = Number.isFinite(risk.aside_arc_mm) ? `at ${number(risk.aside_arc_mm, 0, " mm")} along it, ` : "";
  const lost = Number.isFinite(risk.given_up_mm) ? `; takes ${number(risk.given_up_mm, 2, " mm")} from the tip's step` : "";
  return `${where}${number(risk.aside_clearance_mm, 1, " mm")} to spare${lost}`;
}

// risk: of the last step; null: none was told.
export function showState(status, risk) {
  $("banner").dataset.mood = MOODS[status.state] || "";
  put($("state"), status.state.toUpperCase());
  const running = status.state === "running", held = status.state === "hold";
  const reason = status.reasons[0] || (running ? null : (status.stopped_by || [])[0]);
  const reduced = running && status.risk.scale < 0.98, gives = running ? aside(risk) : "";
  put($("headline"), reason ? reason.text + (reason.detail ? `: ${reason.detail}` : "")
    : reduced ? `The gate lets ${Math.round(100 * status.risk.scale)} % of the step through` : gives ? "The body gives way" : held ? "It was told to hold" : "Nothing stands in the way");
  put($("remedy"), reason ? reason.remedy : reduced ? [status.risk.detail, gives && `the body gives way ${gives}`].filter(Boolean).join("; ") : gives ? gives : held ? "Resume goes on; disarm switches the drives off" : "");
  const aim = status.reference;
  put($("following"), aim ? [aim.trajectory, aim.controller, aim.note, aim.pace < 1 && `slowed to ${number(100 * aim.pace, 0, " %")}`].filter(Boolean).join(" · ") : "nothing is being followed");
  $("progress").hidden = !(aim && aim.duration_s);
  if (aim && aim.duration_s) $("progress").value = aim.elapsed_s / aim.duration_s;
  $("watermark").hidden = !status.simulated;
}

export function showReasons(status) {
  const rows = status.reasons.length ? status.reasons : [{ text: "None", remedy: "" }];
  if (!changed("reasons", rows.map((reason) => [reason.name, reason.subject, reason.text, reason.detail]))) return;
  $("reasons").replaceChildren(...rows.map((reason) => made("li", {},
    made("b", { textContent: reason.subject ? `${reason.subject}: ${reason.text}` : reason.text }),
    made("span", { textContent: reason.remedy || "" }))));
}

export function showFigures(status, risk, frames) {
  const buses = (status.loop.buses || []).map((bus) => `${bus.name} ${number(100 * bus.load, 0, " %")}`).join(", ");
  const rows = {
    "Tracking error": number(status.error_mm, 2, " mm"), "Error expected": number(status.expected_mm, 1, " mm"), "Contact risk": number(status.risk.contact_risk, 4),
    Clearance: number(risk && risk.clearance_mm, 1, " mm"), "Gate lets through": number(100 * status.risk.scale, 0, " %"),
    "Gives way": (status.state === "running" && aside(risk)) || "nowhere",
    Tracker: `${status.tracker.state}, ${number(status.tracker.rate_hz, 0, " Hz")}`, "Tracker quality": number(100 * status.tracker.quality, 0, " %"),
    "Bus cycles": number(status.loop.cycle_rate_hz, 0, " Hz"), "Bus load": buses || "–", "Missed cycles": String(status.loop.missed),
    Recording: status.recording ? status.recording.split("/").pop() : "none", ...frames,
  };
  if (changed("figures", Object.keys(rows))) {
    $("figures").replaceChildren(...Object.keys(rows).flatMap((name) => [made("dt", { textContent: name }), made("dd")]));
  }
  Object.values(rows).forEach((text, n) => put($("figures").children[2 * n + 1], text));
}

export function showDrives(status) {
  const table = $("drives");
  while (table.children.length < status.axes.length) table.append(made("tr", {}, ...Array.from({ length: 6 }, () => made("td"))));
  while (table.children.length > status.axes.length) table.lastChild.remove();
  status.axes.forEach((axis, n) => {
    const range = axis.force_range;
    const outside = range && Number.isFinite(axis.force) && (axis.force < range[0] || axis.force > range[1]);
    const cells = table.children[n].children;
    [axis.name, number(axis.actual, 2, ` ${axis.unit}`), number(axis.target, 2, ` ${axis.unit}`), number(axis.force, 1, ` ${axis.force_unit}`), axis.drive_state, axis.node_state]
      .forEach((text, place) => put(cells[place], text));
    cells[3].classList.toggle("bad", Boolean(outside));
  });
}

export function showCycles(cycles) {
  if (!changed("cycles", cycles)) return;
  $("cyclespanel").hidden = !cycles.length;
  const shown = cycles.slice(-12), worst = Math.max(...shown.map((row) => row.max_mm), 1e-9);
  $("cycles").replaceChildren(...shown.map((row) => {
    const bar = made("meter", { min: 0, max: worst, value: row.mean_mm, ariaLabel: `mean error of cycle ${row.cycle + 1}` });
    return made("tr", {}, made("td", { textContent: row.cycle + 1 }), made("td", { textContent: number(row.mean_mm, 2) }),
      made("td", { textContent: number(row.max_mm, 2) }), made("td", {}, bar));
  }));
}
