// Lets the user mark a ball or move the detected outline, by dragging or by numbers.
//
//     const outline = gonioOutline(stage, form, (x, y, radius) => ...);
//     outline.show(size, circle); // size of the photograph in pixels; the circle may be missing
//     outline.ask(why, guess); // if no ball was detected
globalThis.gonioOutline = (() => {
  "use strict";

  const SVG = "http://www.w3.org/2000/svg";
  const RIM = 0.75; // fraction of the radius: a drag outside changes the radius, a drag inside moves the circle

  return function gonioOutline(stage, form, done) {
    const [svg, circle] = [stage.querySelector("svg"), document.createElementNS(SVG, "circle")];
    let [size, drag] = [[1, 1], null]; // drag: maps the position of the pointer to a circle
    const text = document.createElement("p");
    const inputs = ["Centre, from the left", "Centre, from the top", "Radius"].map((name) => {
      const input = Object.assign(document.createElement("input"), { type: "number", step: "any", min: 0, required: true });
      input.oninput = () => draw(values());
      const label = document.createElement("label");
      label.append(name, input);
      return { input, label };
    });
    const button = Object.assign(document.createElement("button"), { textContent: "Use this outline" });
    form.replaceChildren(text, ...inputs.map(({ label }) => label), button);
    const values = () => inputs.map(({ input }) => input.valueAsNumber);

    function draw([x, y, radius]) {
      if (!(radius > 0)) return svg.replaceChildren();
      for (const [name, value] of Object.entries({ cx: x, cy: y, r: radius })) circle.setAttribute(name, value);
      svg.replaceChildren(circle);
    }

    function set(marked) {
      inputs.forEach(({ input }, i) => (input.value = marked[i].toFixed(1)));
      draw(marked);
    }

    function place(event) {
      const box = svg.getBoundingClientRect();
      return [((event.clientX - box.left) / box.width) * size[0], ((event.clientY - box.top) / box.height) * size[1]];
    }

    stage.onpointerdown = (event) => {
      const marking = stage.classList.contains("marking");
      if (form.hidden || !event.isPrimary || !(marking || event.target === circle)) return;
      event.preventDefault();
      stage.setPointerCapture(event.pointerId);
      const [[u, v], [x, y, radius]] = [place(event), values()];
      const off = Math.hypot(u - x, v - y);
      const resize = (a, b, c, d) => [a, b, Math.hypot(c - a, d - b)];
      if (marking) drag = (c, d) => resize(u, v, c, d);
      else if (off > RIM * radius) drag = (c, d) => resize(x, y, c, d);
      else drag = (c, d) => [x + c - u, y + d - v, radius];
    };
    stage.onpointermove = (event) => drag && set(drag(...place(event)));
    stage.onpointercancel = () => (drag = null);
    stage.onpointerup = () => {
      if (!drag) return;
      drag = null;
      if (!stage.classList.contains("marking")) done(...values());
    };
    form.onsubmit = (event) => {
      event.preventDefault();
      done(...values());
    };

    return {
      show(pixels, found) {
        size = pixels;
        svg.setAttribute("viewBox", `0 0 ${size[0]} ${size[1]}`);
        stage.classList.remove("marking");
        form.hidden = !found;
        if (!found) return draw([]);
        text.textContent = "To correct the outline, drag inside it to move it, or at its rim to change the radius.";
        set([found.x, found.y, found.radius]);
      },
      ask(why, guess) {
        text.textContent = `${why} Mark the ball: drag on the photograph from the centre of the ball to its rim, or enter centre and radius in pixels.`;
        form.hidden = false;
        stage.classList.add("marking");
        if (guess) set([guess.x, guess.y, guess.radius]);
        else if (!values().every(Number.isFinite)) set([size[0] / 2, size[1] / 2, 0.35 * Math.min(...size)]);
        else draw(values());
      },
    };
  };
})();
