// Page of gonio-web: passes a photograph to a worker (worker.js) and displays the results of each step.
(() => {
  "use strict";

  const STEPS = [
    ["photograph", "Photograph"], ["ball", "Ball"], ["material", "Material"],
    ["light 8", "Light, 8 × 8"], ["light 16", "16 × 16"], ["light 32", "32 × 32"],
  ];
  const FILES = [
    ["brdf.binary", "BRDF in the MERL format, 35 MB"],
    ["brdf_rgb.bsdf", "BRDF for the plugin “measured” in RGB variants of Mitsuba 3"],
    ["light.exr", "Light as a lat-long map"],
    ["result.json", "All numbers with their uncertainty"],
  ];

  const at = (id) => document.getElementById(id);
  const make = (name, properties = {}, ...children) => {
    const made = Object.assign(document.createElement(name), properties);
    made.append(...children);
    return made;
  };
  const show = (...ids) => ids.forEach((id) => (at(id).hidden = false));
  const percent = (x) => `${(100 * x).toFixed(x < 0.095 ? 1 : 0)} %`;
  const bytesOf = (id) => Uint8Array.from(atob(at(id).textContent), (c) => c.charCodeAt(0));
  const urls = (parts, type) => URL.createObjectURL(new Blob(parts, { type }));

  /** Decompresses an embedded part of the page. */
  async function unpacked(id) {
    const stream = new Blob([bytesOf(id)]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  /** Reassembles a file whose 4-byte words are stored as four byte planes. */
  function interleaved(planes) {
    const words = planes.length / 4;
    return Uint8Array.from(planes, (_, i) => planes[(i % 4) * words + (i >> 2)]);
  }

  // Module and model are prepared once for all workers, while the page waits for a photograph.
  const compiled = unpacked("module").then((bytes) => WebAssembly.compile(bytes));
  const learnt = unpacked("model").then(interleaved);
  for (const part of [compiled, learnt]) part.catch(() => {}); // begin() reports the error
  let run = null; // the current run: its worker, viewer and results so far
  const outline = gonioOutline(document.querySelector(".stage"), at("outline"), (...marked) => {
    for (const id of ["trouble", "cells", "downloads"]) at(id).hidden = true;
    run.start = performance.now();
    run.worker.postMessage({ outline: marked });
  });

  function tell(text) {
    at("status").textContent = text;
  }

  function trouble(what, advice) {
    at("trouble").replaceChildren(make("p", { textContent: what }), make("p", { textContent: advice }));
    show("trouble");
    tell("");
    for (const step of document.querySelectorAll("#steps .running")) step.className = "failed";
  }

  /** Starts a run with a file. */
  async function begin(name, bytes) {
    run?.worker.terminate();
    run?.viewer?.dispose();
    for (const id of ["trouble", "results", "found", "words", "light", "cells", "downloads"]) at(id).hidden = true;
    document.body.classList.add("busy-or-done");
    at("steps").replaceChildren(...STEPS.map(([key, text]) => {
      const step = make("li", { textContent: text }, make("span", { className: "note" }));
      step.dataset.step = key;
      return step;
    }));
    show("steps");
    tell(`Reading ${name} …`);
    let module, model;
    try {
      [module, model] = await Promise.all([compiled, learnt]);
    } catch (error) {
      return trouble(`This browser cannot run the computation: ${error.message}`, "Use a current version of Chrome, Edge, Firefox or Safari.");
    }
    const source = urls([at("worker").textContent], "text/javascript");
    const worker = new Worker(source);
    worker.addEventListener("message", () => URL.revokeObjectURL(source), { once: true });
    run = { worker, name, start: performance.now(), data: { materials: [], lights: [] }, viewer: null };
    const own = run;
    worker.onmessage = ({ data }) => own === run && heard(data);
    worker.onerror = (event) => {
      event.preventDefault();
      if (own === run) trouble("The computation could not be started.", event.message || "Reload the page and try again.");
    };
    worker.postMessage({ module, model, name, bytes }, [bytes]);
  }

  function heard(message) {
    const listeners = { begin: begun, end: ended, outline: unfound, product: received, failed, finished };
    listeners[message.event](message);
  }

  const stepOf = (name) => document.querySelector(`#steps [data-step="${name}"]`);

  function begun({ step }) {
    if (!stepOf(step)) return;
    stepOf(step).className = "running";
    const texts = { photograph: "Reading", ball: "Detecting the ball", material: "Estimating the material" };
    tell(`${texts[step] ?? "Estimating the light"} …`);
  }

  function ended({ step, seconds, ...found }) {
    if (stepOf(step)) {
      stepOf(step).className = "done";
      stepOf(step).querySelector(".note").textContent = `${seconds.toFixed(seconds < 1 ? 2 : 1)} s`;
    }
    const [kind] = step.split(" ");
    ({ photograph, ball, material, light, drawing })[kind](found);
  }

  function photograph({ png, width, height }) {
    run.size = [width, height];
    const image = document.querySelector(".stage img");
    Object.assign(image, { src: png, alt: `The photograph ${run.name}` });
    at("photograph").querySelector("figcaption").textContent = `${run.name}, ${width} × ${height} pixels`;
    outline.show(run.size);
    show("results");
  }

  function ball({ circle, sure, used, warnings }) {
    if (!circle) return;
    run.warnings = warnings;
    outline.show(run.size, circle);
    const numbers = [circle.x, circle.y, circle.radius].map((value) => value.toFixed(1));
    // The name is quoted for a shell.
    const command = `gonio infer '${run.name.replaceAll("'", "'\\''")}' --circle ${numbers}`;
    at("photograph").querySelector("figcaption").replaceChildren(
      `${run.name}, ${run.size.join(" × ")} pixels. Dashed: outline of the ball, radius ${numbers[2]} pixels` +
      `${sure ? `, ${sure}` : ""}; ${used.toLocaleString("en")} sample points. Equivalent command: `,
      make("code", { textContent: command }));
  }

  function unfound({ why, guess }) {
    stepOf("ball").className = "";
    outline.ask(`${why[0].toUpperCase()}${why.slice(1)}.`, guess);
    tell("The ball was not detected. Mark it on the photograph.");
    at("outline").scrollIntoView({ block: "nearest" });
  }

  function material(found) {
    run.data = { materials: found.materials, lights: found.lights };
    run.shown = performance.now() - run.start;
    show("found", "words");
    view({});
    words(found);
  }

  /** Shows the sphere and preserves the keyboard focus. */
  function view(options) {
    const container = at("sphere");
    const index = [...container.querySelectorAll("*")].indexOf(document.activeElement);
    const material = container.querySelector("select")?.selectedIndex ?? 0;
    run.viewer?.dispose();
    run.viewer = gonioViewer(container, run.data, { material, ...options });
    if (index >= 0) container.querySelectorAll("*")[index]?.focus();
    document.documentElement.dataset.viewer = "drawing";
    run.viewer.ready.then((drawn) => (document.documentElement.dataset.viewer = drawn ? "drawn" : "none"));
  }

  function words({ verdict, undetermined_share, diagnostics, neighbours, coloured }) {
    const facts = {
      Finish: `${verdict[0].toUpperCase()}${verdict.slice(1)}.`,
      Undetermined: `The photograph does not determine ${percent(undetermined_share)} of the BRDF.`,
      Colour: coloured ? "Each channel of the BRDF is estimated from the same channel of the photograph. The light is assumed to be neutral."
        : "None, because the photograph is grey.",
      Scale: "A photograph under unknown light does not determine the albedo; it is set to 0.5 at normal incidence.",
    };
    const list = make("dl", { className: "facts" });
    for (const [name, text] of Object.entries(facts)) {
      list.append(make("dt", { textContent: name }), make("dd", { textContent: text }));
    }
    const most = Math.max(...neighbours.map(({ weight }) => weight));
    const near = make("table", { className: "near" }, ...neighbours.slice(0, 6).map(({ name, weight }) => {
      const bar = make("i", { style: `width: ${(5 * weight) / most}rem` });
      return make("tr", {}, make("th", { scope: "row", textContent: name.replaceAll("-", " ") }), make("td", {}, bar, percent(weight)));
    }));
    if (neighbours.length > 0) list.append(make("dt", { textContent: "Measured materials with the most similar highlights, and their weights" }), make("dd", {}, near));
    at("words").querySelector("div").replaceChildren(make("ul", { className: "diagnostics" }), list);
    warn(diagnostics);
  }

  /** Lists the warnings on the photograph and the diagnostics of the estimate. */
  function warn(diagnostics) {
    const items = [...run.warnings, ...diagnostics].map((textContent) => make("li", { textContent }));
    const list = at("words").querySelector(".diagnostics");
    list.replaceChildren(...items);
    list.hidden = items.length === 0;
  }

  function light({ side, misfit, diagnostics, png, light: packed }) {
    warn(diagnostics);
    show("light");
    Object.assign(at("light").querySelector("img"), { src: png, alt: `Lat-long map of the estimated light, from a grid of ${side} × ${side} texels` });
    at("light").querySelector("figcaption").textContent =
      `Lat-long map with ${side} × ${side} texels over the sphere; the direction behind the ball is in the centre. ` +
      `Misfit (relative residual of the photograph): ${percent(misfit)}.`;
    run.light = packed;
  }

  function drawing({ uncertainty }) {
    at("uncertainty").src = urls([uncertainty], "image/svg+xml");
    show("cells");
  }

  function finished() {
    // Under the estimated light, the sphere looks like the photograph.
    run.data.lights.unshift(run.light);
    view({ light: 0 });
    at("downloads").querySelector("ul").replaceChildren(...FILES.map(([name, text]) => {
      const button = make("button", { type: "button", textContent: name });
      button.dataset.product = name;
      button.onclick = () => {
        button.disabled = true;
        run.worker.postMessage({ product: name });
      };
      return make("li", {}, button, make("span", { textContent: text }));
    }));
    show("downloads");
    const total = (performance.now() - run.start) / 1000;
    Object.assign(document.documentElement.dataset, { firstResult: run.shown / 1000, finished: total });
    tell(`Finished in ${total.toFixed(1)} s (material after ${(run.shown / 1000).toFixed(1)} s).`);
  }

  const buttonOf = (product) => document.querySelector(`[data-product="${product}"]`);

  function received({ product, bytes }) {
    buttonOf(product).disabled = false;
    const url = urls([bytes], "application/octet-stream");
    make("a", { href: url, download: product }).click();
    setTimeout(() => URL.revokeObjectURL(url), 60000);
  }

  function failed({ refused, message, product }) {
    if (product && buttonOf(product)) buttonOf(product).disabled = false;
    if (refused && !at("results").hidden) {
      for (const id of ["found", "words", "light", "cells"]) at(id).hidden = true;
      return trouble(message, "Correct the outline of the ball on the photograph, or drop another one.");
    }
    if (refused) return trouble(message, "Drop the photograph again, or another one.");
    run.worker.terminate();
    trouble(`The computation stopped: ${message}`, "The file may be damaged or too large for this browser. Drop another one.");
  }

  async function take(file) {
    if (!file) return;
    try {
      await begin(file.name, await file.arrayBuffer());
    } catch (error) {
      trouble(`${file.name} cannot be read: ${error.message}`, "Drop one file, not a folder.");
    }
  }

  const zone = at("drop");
  zone.onclick = () => at("file").click();
  at("file").onchange = ({ target }) => {
    take(target.files[0]);
    target.value = ""; // allows the user to choose the same file again
  };
  at("sample").onclick = () => begin("ball.exr", bytesOf("sample-data").buffer);
  // The whole page accepts files, because a file dropped outside the zone would replace the page.
  let depth = 0;
  const hover = (change) => {
    depth = Math.max(depth + change, 0);
    zone.classList.toggle("over", depth > 0);
  };
  addEventListener("dragenter", (event) => (event.preventDefault(), hover(1)));
  addEventListener("dragleave", () => hover(-1));
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    hover(-depth);
    take(event.dataTransfer.files[0]);
  });
})();
