// Lets the user mark a ball whose outline could not be found: by dragging from its centre to its rim, or by numbers.
//
//     const outline = gonioOutline(stage, form, (x, y, radius) => ...);
//     outline.show(size, circle); // of the photograph in pixels; the circle may be missing
//     outline.ask(why);
globalThis.gonioOutline = (() => {
  "use strict";

  const SVG = "http://www.w3.org/2000/svg";

  return function gonioOutline(stage, form, done) {
    const [svg, circle] = [stage.querySelector("svg"), document.createElementNS(SVG, "circle")];
    let [size, centre] = [[1, 1], null];
    const text = document.createElement("p");
    const inputs = ["Centre, from the left", "Centre, from the top", "Radius"].map((name) => {
      const input = Object.assign(document.createElement("input"), { type: "number", step: "any", min: 0, required: true });
      input.oninput = () => draw(values());
      const label = document.createElement("label");
      label.append(name, input);
      return { input, label };
    });
    const button = Object.assign(document.createElement("button"), { textContent: "Go on with this outline" });
    form.replaceChildren(text, ...inputs.map(({ label }) => label), button);
    const values = () => inputs.map(({ input }) => input.valueAsNumber);

    function draw([x, y, radius]) {
      if (!(radius > 0)) return svg.replaceChildren();
      for (const [name, value] of Object.entries({ cx: x, cy: y, r: radius })) circle.setAttribute(name, value);
      svg.replaceChildren(circle);
    }

    function place(event) {
      const box = svg.getBoundingClientRect();
      return [((event.clientX - box.left) / box.width) * size[0], ((event.clientY - box.top) / box.height) * size[1]];
    }

    stage.onpointerdown = (event) => {
      if (form.hidden || !event.isPrimary) return;
      event.preventDefault();
      stage.setPointerCapture(event.pointerId);
      centre = place(event);
    };
    stage.onpointermove = (event) => {
      if (!centre) return;
      const [x, y] = place(event);
      const marked = [...centre, Math.hypot(x - centre[0], y - centre[1])];
      inputs.forEach(({ input }, i) => (input.value = marked[i].toFixed(1)));
      draw(marked);
    };
    stage.onpointerup = stage.onpointercancel = () => (centre = null);
    form.onsubmit = (event) => {
      event.preventDefault();
      done(...values());
    };

    return {
      show(pixels, found) {
        size = pixels;
        svg.setAttribute("viewBox", `0 0 ${size[0]} ${size[1]}`);
        draw(found ? [found.x, found.y, found.radius] : []);
        form.hidden = true;
        stage.classList.remove("marking");
      },
      ask(why) {
        text.textContent = `${why} Mark the ball: drag on the photograph from its centre to its rim, or give both in pixels.`;
        form.hidden = false;
        stage.classList.add("marking");
        if (!values().every(Number.isFinite)) {
          const guess = [size[0] / 2, size[1] / 2, 0.35 * Math.min(...size)];
          inputs.forEach(({ input }, i) => (input.value = guess[i].toFixed(1)));
        }
        draw(values());
      },
    };
  };
})();
