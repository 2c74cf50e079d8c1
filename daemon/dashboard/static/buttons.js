// The commands: as the server says of each whether it may be pressed, and asked for with one request.
import { $, put, post } from "./dom.js";
import { page } from "./page_id.js";

export async function ask(verb, more = {}) {
  let told;
  try {
    const response = await post("api/do", { robot: $("robot").value, page, verb, ...more });
    told = response.ok ? await response.json() : { ok: false, text: await response.text() };
  } catch (error) {
    told = { ok: false, text: error.message };
  }
  const reasons = (told.reasons || []).map((reason) => `${reason.text}. ${reason.remedy}`);
  const words = [told.text, ...reasons].filter(Boolean).join(" — ");
  $("answer").className = told.ok ? "" : "bad";
  put($("answer"), words || (told.ok ? `${verb}: done` : `${verb}: refused`));
  return told;
}

let shown = "";
export const forgetButtons = () => { shown = ""; };

export function showButtons(told) {
  const key = JSON.stringify(told.map((button) => [button.verb, button.enabled, button.why]));
  if (shown === key) return;
  shown = key;
  for (const button of told) {
    let drawn = document.querySelector(`[data-verb="${button.verb}"]`);
    if (!drawn) { drawn = made(button); $("buttons").append(drawn); }
    drawn.disabled = !button.enabled;
    drawn.title = button.enabled ? (button.hold_s ? "press and hold" : "") : [button.why, button.helps].filter(Boolean).join(". ");
  }
}

function made(button) {
  const drawn = document.createElement("button");
  drawn.type = "button";
  drawn.dataset.verb = button.verb;
  drawn.textContent = button.hold_s ? `${button.label} (hold)` : button.label;
  if (!button.hold_s) { drawn.addEventListener("click", () => ask(button.verb)); return drawn; }
  let timer = 0;
  const begin = () => { if (drawn.disabled || timer) return; drawn.classList.add("pressing"); timer = setTimeout(() => { end(); ask(button.verb); }, button.hold_s * 1000); };
  const end = () => { clearTimeout(timer); timer = 0; drawn.classList.remove("pressing"); };
  drawn.addEventListener("pointerdown", begin);
  for (const kind of ["pointerup", "pointerleave", "pointercancel", "lostpointercapture", "blur"]) drawn.addEventListener(kind, end);
  drawn.addEventListener("keydown", (event) => { if ((event.key === "Enter" || event.key === " ") && !event.repeat) begin(); });
  drawn.addEventListener("keyup", end);
  addEventListener("blur", end);
  return drawn;
}
