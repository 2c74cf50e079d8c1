// The other end of an easel that stands beside the page. Modules here are found by their paths only.
import { Drawing } from "./drawing.js";

let drawing = null;

// The browser takes a worker's picture at the end of its next frame, and has it when the next task is begun.
const handOver = () => new Promise((settle) => {
  requestAnimationFrame(() => {
    const from = performance.now();
    setTimeout(() => settle([from, performance.now()]), 0);
  });
});

function open(canvas) {
  try { drawing = new Drawing(canvas, handOver); } catch { /* there is no WebGL in a worker here: it is told */ }
  postMessage({ opened: Boolean(drawing) });
}

async function draw(picture) {
  try { postMessage(await drawing.draw(picture)); } catch (error) { postMessage({ problem: String(error) }); }
}

onmessage = ({ data }) => (data.canvas ? open(data.canvas) : draw(data));
