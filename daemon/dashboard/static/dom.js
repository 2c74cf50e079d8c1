// What all modules of the page share: finding elements, putting text into them, showing numbers.
export const $ = (id) => document.getElementById(id);

export const put = (element, text) => { if (element.textContent !== text) element.textContent = text; };

export const number = (value, digits = 1, unit = "") =>
  value === null || value === undefined || !Number.isFinite(value) ? "–" : `${value.toFixed(digits)}${unit}`;

export function made(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name === "dataset") Object.assign(element.dataset, value);
    else if (name.startsWith("aria")) element.setAttribute(`aria-${name.slice(4).toLowerCase()}`, value);
    else element[name] = value;
  }
  element.append(...children);
  return element;
}

export function clock(seconds) {
  const whole = Math.max(0, Math.floor(seconds)), tenths = Math.floor((Math.max(0, seconds) - whole) * 10);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}.${tenths}`;
}

// as: `json`, or what else a response is made of. within_ms: then it is given up, where that is said.
export async function told(path, as = "json", within_ms = 0) {
  const response = await fetch(path, within_ms ? { signal: AbortSignal.timeout(within_ms) } : {});
  if (!response.ok) throw Object.assign(new Error(await response.text()), { status: response.status });
  return response[as]();
}

export function post(path, body) {
  return fetch(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
}

// Whether somebody is writing, choosing or pressing: then no shortcut acts but Esc.
export const busyWith = (target) => Boolean(target && target.closest && target.closest("input, select, button, textarea, a, summary"));
