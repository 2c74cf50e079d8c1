// Where the robot is drawn: by a worker beside the page, so that what is pressed there waits for no picture; in the
// page where a browser's workers cannot draw. An easel takes one picture at a time, and promises what `Drawing.draw` does.
export async function openEasel(element) {
  const canvas = document.createElement("canvas");
  const easel = (canvas.transferControlToOffscreen && (await beside(canvas))) || (await here());
  element.prepend(easel.canvas);
  return easel;
}

const OPENED_WITHIN_MS = 10000;

// null: workers have no WebGL, or know no modules.
async function beside(canvas) {
  const worker = new Worker(new URL("./drawing_worker.js", import.meta.url), { type: "module" });
  const opened = new Promise((settle) => {
    worker.onmessage = ({ data }) => settle(data.opened);
    worker.onerror = () => settle(false);
    setTimeout(() => settle(false), OPENED_WITHIN_MS);
  });
  const offscreen = canvas.transferControlToOffscreen();
  worker.postMessage({ canvas: offscreen }, [offscreen]);
  if (!(await opened)) { worker.terminate(); return null; }
  return {
    canvas, beside: true,
    draw(picture) {
      const drawn = new Promise((settle, fail) => {
        worker.onmessage = ({ data: { problem, took_ms, at_ms } }) => {
          if (problem) fail(new Error(problem));
          else settle({ took_ms, at_ms });
        };
      });
      worker.postMessage(picture);
      return drawn;
    },
  };
}

// Throws where there is no WebGL at all. A canvas that was given to a worker is not got back.
async function here() {
  const { Drawing } = await import("./drawing.js");
  const canvas = document.createElement("canvas"), drawing = new Drawing(canvas);
  return { canvas, beside: false, draw: (picture) => drawing.draw(picture) };
}
