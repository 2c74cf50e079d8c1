// STOP stands alone: it needs neither the telemetry nor the picture, and waits for nothing of theirs.
const button = document.getElementById("stop");
const says = document.getElementById("stopsays");
const picked = document.getElementById("robot");
const ANSWERS_WITHIN_MS = 6000;

async function stop() {
  const began = performance.now();
  says.dataset.outcome = "asked";
  says.textContent = "STOP sent …";
  try {
    const response = await fetch("api/stop", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ robot: picked.value }),
      keepalive: true,
      signal: AbortSignal.timeout(ANSWERS_WITHIN_MS),
    });
    if (!response.ok) throw new Error(await response.text());
    const told = await response.json();
    const ms = Math.round(performance.now() - began);
    says.dataset.outcome = told.outcome;
    if (told.outcome === "confirmed") says.textContent = `STOP confirmed by the drives in ${ms} ms`;
    else if (told.outcome === "not confirmed") says.textContent = "STOP NOT CONFIRMED by the drives: use the emergency stop";
    else says.textContent = `No answer to STOP: use the emergency stop. ${told.text}`;
  } catch (error) {
    says.dataset.outcome = "no answer";
    says.textContent = `No answer to STOP: use the emergency stop. ${error.message}`;
  }
}

button.addEventListener("pointerdown", (event) => { if (event.button === 0) stop(); });
button.addEventListener("keydown", (event) => {
  if ((event.key === "Enter" || event.key === " ") && !event.repeat) { event.preventDefault(); stop(); }
});
button.addEventListener("click", (event) => { if (event.detail === 0 && event.isTrusted === false) stop(); });
addEventListener("keydown", (event) => {
  if (event.key === "Escape" && !event.repeat) { event.preventDefault(); stop(); }
}, { capture: true });
