// An interactive sphere of an isotropic BRDF over half and difference angle, seen from the front in a lat-long light
// that can be turned around it.
//
//     const viewer = gonioViewer(container, data, { material: 0, light: 0, samples: 512, showLight: false });
//
// `data` holds `materials` (tables of 90 x 90 cells) and `lights` (lat-long maps), both packed as 16-bit logarithms.
// The radiance of every pixel is an integral over the light, estimated by samples that are added up until `samples` of
// them are in; turning or choosing anything starts again. Nothing moves by itself, and a finished picture costs nothing.
// renderer.js goes before this.
globalThis.gonioViewer = (() => {
  "use strict";

  const FRAME_TIME = 30; // what a frame may take, ms
  const POLL = 4; // between looks whether it is finished, ms
  const MOST_SAMPLES = 32; // that a frame adds to a pixel
  const LEAST_WORK = 1e5; // of a frame, samples times pixels: less would hardly be faster, for a frame has its own price
  const DRAFT_STEP = 8; // samples that a frame adds to a draft, the smaller picture that a slow device begins with
  const COARSEST = 4; // pixels of the canvas along one of a draft, at most
  const DRAFT_SAMPLES = 32; // that a draft gets before the full picture begins
  const PRESENTABLE = 12; // samples of a pixel from which on the full picture looks better than the draft
  const FIT_TO_REPLACE = 32; // samples from which on it looks better than a picture that was there before
  const REST = 200; // delay between the last change and its announcement, ms
  const MAX_PITCH = 85;
  const KEY_STEP = 5;

  /** An element with properties, attributes and children. */
  function element(name, { attributes = {}, ...properties } = {}, ...children) {
    const made = Object.assign(document.createElement(name), properties);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  }

  return function gonioViewer(container, data, options = {}) {
    const state = { material: 0, light: 0, yaw: 0, pitch: 0, stops: 0, showLight: false, samples: 512, ...options };
    // The picture in the container, shown until the sphere is drawn.
    const still = container.querySelector("img");
    const canvas = element("canvas", { tabIndex: 0, attributes: { role: "application" } });
    const gl = canvas.getContext("webgl2", { antialias: false, depth: false });
    let renderer;
    try {
      if (!gl) throw new Error("no WebGL 2");
      renderer = new GonioRenderer(gl, data);
    } catch (error) {
      console.info(`gonioViewer: ${error.message}`);
      const why = "The interactive sphere requires WebGL 2 with float textures, which this browser does not provide.";
      container.replaceChildren(...(still ? [still] : []), element("p", { className: "gonio-viewer-fallback", textContent: why }));
      const dispose = () => container.replaceChildren();
      return { dispose, setMaterial() {}, setLight() {}, ready: Promise.resolve(false) };
    }

    if (still) canvas.style.backgroundImage = `url(${still.src})`;
    let waiting = Boolean(still); // until something is turned or chosen, or the picture is good enough
    let fine, draft; // the full picture, and the smaller one while the light turns on a slow device
    let side = 0; // of the canvas
    let budget = LEAST_WORK; // of the next frame, corrected by every one
    let flight = null; // the fence of the frame on its way through the device
    let [stale, onScreen, request, statusTimer, held] = [true, true, 0, 0, null];
    let isReady;
    const ready = new Promise((resolve) => (isReady = resolve));

    const wake = () => (request ||= requestAnimationFrame(frame));
    const redraw = () => {
      stale = true;
      wake();
    };
    const restart = () => {
      for (const target of [fine, draft]) if (target) renderer.restart(target);
      redraw();
    };

    /** The target itself if it is in use or its side is right, otherwise a new one. */
    function fitted(target, wanted) {
      if (target?.samples > 0 || target?.row > 0 || target?.side === wanted) return target;
      if (target) renderer.free(target);
      return renderer.target(wanted);
    }

    /** Waits for the device to finish a frame, and sets the work of the next one by its time. */
    function launch(work, then = () => {}) {
      const start = performance.now();
      flight = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
      const land = (own) => {
        // A lost context takes its fences along.
        if (flight !== own) return;
        if (gl.getSyncParameter(own, gl.SYNC_STATUS) !== gl.SIGNALED) return void setTimeout(land, POLL, own);
        gl.deleteSync(own);
        flight = null;
        // A small remainder of a picture is not representative, nor is one slow frame (compilation, layout).
        const change = FRAME_TIME / (performance.now() - start);
        if (work > 0.5 * budget) budget = Math.max(work * Math.min(Math.max(change, 0.7), 1.4), LEAST_WORK);
        then();
        wake();
      };
      setTimeout(land, POLL, flight);
    }

    function frame() {
      request = 0;
      if (side === 0 || flight || gl.isContextLost()) return;
      if (!renderer.exposure(state)) return launch(0, renderer.measure(state));
      const coarseness = Math.min(Math.ceil(side * Math.sqrt(DRAFT_STEP / budget)), COARSEST);
      const isDraft = coarseness > 1 && onScreen && !(draft?.samples >= DRAFT_SAMPLES);
      if (isDraft) draft = fitted(draft, Math.ceil(side / coarseness));
      else fine = fitted(fine, side);
      const target = isDraft ? draft : fine;
      // Out of sight, a presentable picture is enough.
      const left = (onScreen ? state.samples : PRESENTABLE) - target.samples;
      if (left <= 0 && !stale) return;
      const work = left > 0 ? renderer.add(target, budget, Math.min(left, MOST_SAMPLES), state) : 0;
      const shown = fine?.samples >= PRESENTABLE || !draft?.samples ? fine : draft;
      if (waiting && left > 0 && !(fine?.samples >= FIT_TO_REPLACE)) return launch(work);
      waiting = false;
      if (shown?.samples > 0 && (target.row === 0 || stale)) {
        renderer.show(shown, side, state);
        canvas.style.backgroundImage = "none";
        stale = false;
        isReady(true);
      }
      launch(work);
    }

    function describe() {
      const [material, light] = [data.materials[state.material].name, data.lights[state.light].name];
      canvas.setAttribute("aria-label", `Sphere. Material: ${material}. Light: ${light}.`);
      stops.textContent = `${state.stops > 0 ? "+" : ""}${state.stops} stops`;
      exposure.setAttribute("aria-valuetext", stops.textContent);
      const way = (angle, positive, negative) => {
        return Math.round(angle) ? [`${Math.abs(Math.round(angle))}° ${angle > 0 ? positive : negative}`] : [];
      };
      const turns = [...way(state.yaw, "to the right", "to the left"), ...way(state.pitch, "up", "down")].join(" and ");
      // Once it has come to rest: a live region that changes all the time cannot be listened to.
      clearTimeout(statusTimer);
      const text = `Material: ${material}. Light: ${light}${turns && `, turned ${turns}`}.`;
      statusTimer = setTimeout(() => (status.textContent = text), REST);
    }

    function turn(yaw, pitch) {
      waiting = false;
      state.yaw = yaw - 360 * Math.round(yaw / 360);
      state.pitch = Math.min(Math.max(pitch, -MAX_PITCH), MAX_PITCH);
      describe();
      restart();
    }

    function chooser(kind, label, entries) {
      const select = element("select", {}, ...entries.map(({ name }) => new Option(name)));
      const choose = (index) => {
        waiting = false;
        state[kind] = select.selectedIndex = index;
        describe();
        restart();
      };
      select.selectedIndex = state[kind];
      select.onchange = () => choose(select.selectedIndex);
      const caption = element("span", { textContent: label });
      return [choose, element("label", { hidden: entries.length < 2 }, caption, select)];
    }
    const [setMaterial, materials] = chooser("material", "Material", data.materials);
    const [setLight, lights] = chooser("light", "Light", data.lights);
    const exposure = element("input", { type: "range", min: -4, max: 4, step: 0.25, value: state.stops });
    exposure.oninput = () => {
      waiting = false;
      state.stops = exposure.valueAsNumber;
      describe();
      redraw();
    };
    const stops = element("span");
    const behind = element("input", { type: "checkbox", checked: state.showLight });
    behind.onchange = () => {
      waiting = false;
      state.showLight = behind.checked;
      redraw();
    };
    const status = element("p", { attributes: { role: "status" } });
    container.replaceChildren(element("div", { className: "gonio-viewer" }, canvas,
      element("p", { textContent: "To rotate the light, drag across the sphere or use the arrow keys." }),
      element("div", {}, materials, lights,
        element("label", {}, element("span", { textContent: "Exposure" }), exposure, stops),
        element("label", {}, behind, element("span", { textContent: "Show the light behind" })),
        element("button", { type: "button", textContent: "Reset the rotation", onclick: () => turn(0, 0) })),
      status));

    canvas.onpointerdown = (event) => {
      if (!event.isPrimary || event.button !== 0) return;
      canvas.setPointerCapture(event.pointerId);
      held = event;
    };
    canvas.onpointermove = (event) => {
      if (event.pointerId !== held?.pointerId) return;
      const scale = 180 / canvas.clientWidth; // half a turn across the sphere
      turn(state.yaw + scale * (event.clientX - held.clientX), state.pitch - scale * (event.clientY - held.clientY));
      held = event;
    };
    canvas.onpointerup = canvas.onpointercancel = () => (held = null);
    canvas.ondblclick = () => turn(0, 0);
    canvas.onkeydown = (event) => {
      const { yaw, pitch } = state;
      const goal = { Home: [0, 0], ArrowLeft: [yaw - KEY_STEP, pitch], ArrowRight: [yaw + KEY_STEP, pitch],
        ArrowUp: [yaw, pitch + KEY_STEP], ArrowDown: [yaw, pitch - KEY_STEP] }[event.key];
      if (!goal || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      turn(...goal);
    };
    // All data on the device are lost with the context; the viewer creates them again when it draws.
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      fine = draft = flight = null;
    });
    canvas.addEventListener("webglcontextrestored", () => {
      renderer = new GonioRenderer(gl, data);
      restart();
    });

    function resize() {
      const wanted = Math.min(Math.round(canvas.clientWidth * devicePixelRatio), 1024);
      if (wanted === side) return;
      canvas.width = canvas.height = side = wanted;
      restart();
    }
    const resizes = new ResizeObserver(resize);
    resizes.observe(canvas);
    // Zooming changes the ratio of pixels where it need not change the layout.
    addEventListener("resize", resize);
    const sight = new IntersectionObserver((entries) => {
      onScreen = entries.at(-1).isIntersecting;
      wake();
    });
    sight.observe(canvas);
    describe();

    return {
      ready, setMaterial, setLight,
      /** Samples of a pixel that the full picture has. */
      get samples() {
        return fine?.samples ?? 0;
      },
      /** Linear radiance of the full picture at a point of the sphere, -1 to 1 to the right and up. */
      readRadiance: (x, y) => renderer.radianceAt(fine, x, y),
      dispose() {
        flight = null;
        resizes.disconnect();
        sight.disconnect();
        removeEventListener("resize", resize);
        cancelAnimationFrame(request);
        clearTimeout(statusTimer);
        gl.getExtension("WEBGL_lose_context")?.loseContext();
        container.replaceChildren();
      },
    };
  };
})();
