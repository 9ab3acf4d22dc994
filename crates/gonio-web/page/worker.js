// Runs one session of gonio-web. The JavaScript binding of the module precedes this file.
//
// Messages in: { module, model, name, bytes } once; { outline } marks the ball; { product } requests a file.
// Messages out: { event, ... }: "begin" and "end" of a step, "outline" if the user must mark the ball, "product", "finished", "failed".
"use strict";

const PREVIEW = 720; // largest side of the displayed photograph in pixels
const GRIDS = [8, 16, 32]; // texels per side of the light grids; the last is that of the program

const seconds = {};
let session, panic;
globalThis.gonioPanicked = (message) => (panic = message);

/** Runs a step, reports its begin and end, and returns its result. */
function step(name, work) {
  postMessage({ event: "begin", step: name });
  const start = performance.now();
  const found = work();
  seconds[name] = (performance.now() - start) / 1000;
  postMessage({ event: "end", step: name, seconds: seconds[name], ...found });
  return found;
}

function open({ module, model, name, bytes }) {
  step("photograph", () => {
    wasm_bindgen.initSync({ module });
    wasm_bindgen.prepare();
    session = new wasm_bindgen.Session(model, name, new Uint8Array(bytes));
    return JSON.parse(session.preview(PREVIEW));
  });
  observe();
}

function observe(outline) {
  const { circle, why, guess } = step("ball", () => JSON.parse(session.observe(outline && Float64Array.from(outline))));
  if (!circle) return postMessage({ event: "outline", why, guess });
  step("material", () => JSON.parse(session.material()));
  for (const side of GRIDS) step(`light ${side}`, () => JSON.parse(session.light(side)));
  step("drawing", () => ({ uncertainty: session.uncertainty() }));
  postMessage({ event: "finished", seconds });
}

function give(product) {
  const bytes = session.product(product, JSON.stringify(seconds));
  postMessage({ event: "product", product, bytes }, [bytes.buffer]);
}

onmessage = ({ data }) => {
  try {
    if (data.module) open(data);
    else if (data.outline) observe(data.outline);
    else if (data.product) give(data.product);
  } catch (error) {
    // The library throws strings; any other error is a fault, after which the module is unusable.
    const refused = typeof error === "string";
    postMessage({ event: "failed", refused, message: refused ? error : panic ?? String(error), product: data.product });
  }
};
