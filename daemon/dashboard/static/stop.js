// STOP stands alone: it needs neither the telemetry nor the picture, and waits for nothing of theirs. It goes by
// a line of its own that is open before it is wanted; and as a request besides where that brings nothing at once.
const button = document.getElementById("stop");
const says = document.getElementById("stopsays");
const picked = document.getElementById("robot");
const ANSWERS_WITHIN_MS = 6000, TAKEN_WITHIN_MS = 40, AGAIN_MS = 500;
let line = null, newest = null;

function open() {
  line = new WebSocket(`${location.origin.replace(/^http/, "ws")}/stop`);
  line.binaryType = "arraybuffer";
  line.onmessage = (message) => hear(JSON.parse(new TextDecoder().decode(message.data)));
  line.onclose = () => setTimeout(open, AGAIN_MS);
}

// Of the STOP that was pressed last: one that was answered before tells nothing of this one.
function hear(told) {
  if (!newest || told.n !== newest.n) return;
  newest.sent = newest.sent || Boolean(told.sent) || told.outcome !== "no answer";
  if (told.outcome === "no answer") { if (!newest.asked) ask(newest); }
  else if (told.outcome) tell(newest, told);
}

function tell(one, told) {
  if (one !== newest || one.told) return;
  one.told = true;
  says.dataset.outcome = told.outcome;
  if (told.outcome === "confirmed") says.textContent = `STOP confirmed by the drives in ${Math.round(performance.now() - one.began)} ms`;
  else if (told.outcome === "not confirmed") says.textContent = "STOP NOT CONFIRMED by the drives: use the emergency stop";
  else says.textContent = `No answer to STOP: use the emergency stop. ${told.text}`;
}

function stop() {
  const one = newest = { n: newest ? newest.n + 1 : 1, began: performance.now(), robot: picked.value };
  const open = line && line.readyState === WebSocket.OPEN;
  if (open) line.send(JSON.stringify({ robot: one.robot, n: one.n }));
  says.dataset.outcome = "asked";
  says.textContent = "STOP sent …";
  if (open) setTimeout(() => { if (!one.sent) ask(one); }, TAKEN_WITHIN_MS);
  else ask(one);
  setTimeout(() => tell(one, { outcome: "no answer", text: `${ANSWERS_WITHIN_MS / 1000} s have passed.` }), ANSWERS_WITHIN_MS);
}

async function ask(one) {
  one.asked = true;
  try {
    const response = await fetch("api/stop", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ robot: one.robot }),
      keepalive: true,
      signal: AbortSignal.timeout(ANSWERS_WITHIN_MS),
    });
    if (!response.ok) throw new Error(await response.text());
    tell(one, await response.json());
  } catch (error) {
    tell(one, { outcome: "no answer", text: error.message });
  }
}

open();
button.addEventListener("pointerdown", (event) => { if (event.button === 0) stop(); });
button.addEventListener("keydown", (event) => {
  if ((event.key === "Enter" || event.key === " ") && !event.repeat) { event.preventDefault(); stop(); }
});
button.addEventListener("click", (event) => { if (event.detail === 0 && event.isTrusted === false) stop(); });
addEventListener("keydown", (event) => {
  if (event.key === "Escape" && !event.repeat) { event.preventDefault(); stop(); }
}, { capture: true });
