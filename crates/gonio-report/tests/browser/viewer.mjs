// Opens the example in a browser with a software WebGL 2 and checks what the viewer shows, how it is used, and its numbers.
//
//     python3 viewer_example.py EXAMPLE.html && node viewer.mjs EXAMPLE.html [FOLDER_FOR_SCREENSHOTS]
//
// CHROMIUM names the browser, /usr/bin/chromium otherwise.
import { existsSync } from "node:fs";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";
import { FLAGS } from "./flags.mjs";

const [example, SHOTS] = process.argv.slice(2);
const PAGE = resolve(example ?? "example.html");
if (!existsSync(PAGE)) {
  console.error(`${PAGE}: no such file; make it with viewer_example.py`);
  process.exit(2);
}
const url = pathToFileURL(PAGE).href;
let failures = 0;

function check(name, passed, found = "") {
  if (!passed) failures++;
  console.log(`${passed ? "ok  " : "FAIL"} ${name}${found === "" ? "" : `: ${found}`}`);
}

async function open(browser, { width = 360, height = 900, colorScheme = "light", before } = {}) {
  const context = await browser.newContext({ viewport: { width, height }, colorScheme });
  const page = await context.newPage();
  const faults = [];
  page.on("console", (message) => {
    if (["error", "warning"].includes(message.type())) faults.push(`console ${message.type()}: ${message.text()}`);
  });
  page.on("pageerror", (error) => faults.push(error.message));
  page.on("request", (request) => {
    const asked = request.url();
    if (asked.split("#")[0] !== url && !asked.startsWith("data:")) faults.push(`asks for ${asked.slice(0, 100)}`);
  });
  if (before) await page.addInitScript(before);
  await page.goto(url, { waitUntil: "load" });
  const works = await page.evaluate(() => viewer.ready);
  return { page, faults, works, close: () => context.close() };
}

/** Waits until the full picture has so many samples of a pixel. */
const settle = (page, samples = 48) =>
  page.waitForFunction((n) => viewer.samples >= n, samples, { timeout: 300_000, polling: 50 });

/** The pixels of the canvas as the page shows them. */
async function pixels(page) {
  const png = (await page.locator("canvas").screenshot()).toString("base64");
  return page.evaluate(async (png) => {
    const image = await createImageBitmap(await (await fetch(`data:image/png;base64,${png}`)).blob());
    const canvas = new OffscreenCanvas(image.width, image.height);
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0);
    return { side: image.width, rgba: [...context.getImageData(0, 0, image.width, image.height).data] };
  }, png);
}

const at = ({ side, rgba }, x, y) => {
  const to = (c) => Math.floor((0.5 + (0.5 * c) / 1.03) * side);
  return rgba.slice(4 * (to(-y) * side + to(x)), 4 * (to(-y) * side + to(x)) + 3);
};

const difference = (a, b) => a.rgba.reduce((sum, x, i) => sum + Math.abs(x - b.rgba[i]), 0) / a.rgba.length;

async function looksAndUse(browser) {
  const { page, faults, works, close } = await open(browser);
  check("starts", works === true);
  await settle(page);
  const first = await pixels(page);
  const points = [[0, 0], [0.5, 0.5], [-0.5, 0.5], [0.5, -0.5], [-0.6, -0.6], [0, 0.95], [0.95, 0]];
  const ground = at(first, -1, 1);
  const shown = points.map(([x, y]) => at(first, x, y));
  check("the sphere is not black", shown.every((p) => Math.max(...p) > 25), shown.map((p) => p.join("/")).join(" "));
  check("the sphere is not the ground", shown.every((p) => p.some((c, i) => Math.abs(c - ground[i]) > 8)));

  const box = await page.locator("canvas").boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 80, y - 30, { steps: 4 });
  await page.mouse.up();
  await settle(page);
  const dragged = await pixels(page);
  check("dragging turns", difference(first, dragged) > 1, difference(first, dragged).toFixed(2));
  check("the status tells", /turned \d+° to the right and \d+° up/.test(await page.getByRole("status").textContent()));
  await page.mouse.move(x, y);
  await page.mouse.dblclick(x, y);
  await settle(page);
  check("a double click turns back", difference(first, await pixels(page)) < 0.25 * difference(first, dragged));

  await page.locator("canvas").focus();
  for (let i = 0; i < 6; i++) await page.keyboard.press("ArrowLeft");
  await page.keyboard.press("ArrowDown");
  await settle(page);
  const keyed = await pixels(page);
  check("arrow keys turn", difference(first, keyed) > 1, difference(first, keyed).toFixed(2));
  await page.waitForTimeout(300);
  check("by five degrees", /turned 30° to the left and 5° down/.test(await page.getByRole("status").textContent()));
  for (let i = 0; i < 30; i++) await page.keyboard.press("ArrowUp");
  await page.waitForTimeout(300);
  check("the pitch ends at 85", /85° up/.test(await page.getByRole("status").textContent()));
  await page.keyboard.press("Home");
  await settle(page);
  const home = difference(first, await pixels(page));
  check("Home turns back", home < 0.25 * difference(first, keyed), home.toFixed(2));

  await page.getByRole("combobox", { name: "Material" }).selectOption("chrome");
  await settle(page);
  const other = await pixels(page);
  check("choosing a material changes the picture", difference(first, other) > 1, difference(first, other).toFixed(2));
  await page.getByRole("combobox", { name: "Light" }).selectOption("sun");
  await settle(page);
  const lit = await pixels(page);
  check("choosing a light changes the picture", difference(other, lit) > 1, difference(other, lit).toFixed(2));
  await page.waitForTimeout(300);
  check("the status names both", /chrome.*sun/.test(await page.getByRole("status").textContent()));
  await page.getByLabel("Exposure").fill("2");
  await page.waitForTimeout(300);
  check("the exposure changes the picture", difference(lit, await pixels(page)) > 1);
  await page.getByLabel("Exposure").fill("0");
  await page.getByLabel("Show the light behind").check();
  await page.waitForTimeout(300);
  const behind = at(await pixels(page), -1, 1);
  check("the light behind is shown", behind.some((c, i) => Math.abs(c - ground[i]) > 8), behind.join("/"));
  await page.evaluate(() => { viewer.setMaterial(1); viewer.setLight(0); });
  check("it can be chosen from outside", (await page.getByRole("combobox", { name: "Material" }).inputValue()) === "matte");

  const canvas = page.getByRole("application");
  check("the canvas has a name", /matte.*studio/.test(await canvas.getAttribute("aria-label")), await canvas.getAttribute("aria-label"));
  check("the canvas takes the focus", (await canvas.getAttribute("tabindex")) === "0");
  const unnamed = await page.evaluate(() =>
    [...document.querySelectorAll(".gonio-viewer select, .gonio-viewer input")].filter((e) => !e.labels[0]?.textContent.trim()).length);
  check("every chooser has a label", unnamed === 0);

  await page.evaluate(() => {
    globalThis.loss = document.querySelector("canvas").getContext("webgl2").getExtension("WEBGL_lose_context");
    loss.loseContext();
  });
  await page.waitForTimeout(300);
  await page.evaluate(() => loss.restoreContext());
  await page.waitForFunction(() => viewer.samples < 8);
  await settle(page);
  const restored = await pixels(page);
  check("a lost context comes back", Math.max(...at(restored, 0, 0)) > 25);
  await page.evaluate(() => viewer.dispose());
  check("dispose leaves nothing", (await page.locator("#sphere > *").count()) === 0);
  // Chromium prints the intended loss of the context to the console.
  const told = faults.filter((text) => !/CONTEXT_LOST_WEBGL|loseContext/.test(text));
  check("no complaints, nothing asked for", told.length === 0, told.join("; "));
  await close();
}

async function idle(browser) {
  const { page, close } = await open(browser, { width: 320, before: () => {
    globalThis.frames = 0;
    const ask = requestAnimationFrame;
    globalThis.requestAnimationFrame = (f) => { frames++; return ask(f); };
  } });
  const start = Date.now();
  await settle(page, 512);
  console.log(`     512 samples at ${await page.evaluate(() => document.querySelector("canvas").width)} pixels took ${Date.now() - start} ms, ${await page.evaluate(() => frames)} frames`);
  await page.waitForTimeout(300);
  const before = await page.evaluate(() => frames);
  await page.waitForTimeout(500);
  check("a finished picture is left alone", (await page.evaluate(() => frames)) === before);
  await close();
}

async function phone(browser) {
  for (const colorScheme of ["light", "dark"]) {
    const { page, faults, close } = await open(browser, { width: 320, height: 700, colorScheme });
    const over = await page.evaluate(() => {
      const root = document.documentElement;
      const wide = [...document.querySelectorAll("body *")].filter((e) => e.getBoundingClientRect().right > root.clientWidth + 0.5);
      return { page: root.scrollWidth - root.clientWidth, wide: wide.map((e) => e.tagName) };
    });
    check(`fits 320 pixels, ${colorScheme}`, over.page <= 0 && over.wide.length === 0, JSON.stringify(over));
    check(`no complaints, ${colorScheme}`, faults.length === 0, faults.join("; "));
    if (SHOTS) {
      await settle(page);
      await page.screenshot({ path: join(SHOTS, `phone-${colorScheme}.png`), fullPage: true });
    }
    await close();
  }
}

async function without(browser) {
  const none = await open(browser, { before: () => (HTMLCanvasElement.prototype.getContext = () => null) });
  check("says so without WebGL 2", none.works === false && /WebGL 2/.test(await none.page.locator("#sphere").textContent()));
  check("no complaints without WebGL 2", none.faults.length === 0, none.faults.join("; "));
  await none.close();
  const half = await open(browser, { width: 320, before: () => {
    const ask = WebGL2RenderingContext.prototype.getExtension;
    WebGL2RenderingContext.prototype.getExtension = function (name) {
      return name === "EXT_color_buffer_float" ? null : ask.call(this, name);
    };
  } });
  await settle(half.page);
  check("works with half floats", half.works && Math.max(...at(await pixels(half.page), 0, 0)) > 25 && half.faults.length === 0, half.faults.join("; "));
  await half.close();
}

function unpack({ low, high, codes }) {
  const bytes = Buffer.from(codes, "base64");
  return Float64Array.from({ length: bytes.length / 2 }, (_, i) => {
    const code = bytes.readUInt16LE(2 * i);
    return code === 0 ? 0 : 2 ** (low + ((high - low) * (code - 1)) / 65534);
  });
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const unit = (v) => v.map((c) => c / Math.hypot(...v));

/** Radiance by the sum over all texels of the light, each split into `split` by `split`. */
function integral(material, light, [x, y], yaw, pitch, split) {
  const [table, rgb] = [unpack(material), unpack(light)];
  const { width, height } = light;
  const normal = [x, y, Math.sqrt(1 - x * x - y * y)];
  const radians = Math.PI / 180;
  const sum = [0, 0, 0];
  for (let i = 0; i < height * split; i++) {
    const v = (i + 0.5) / split;
    const polar = (Math.PI * v) / height;
    const area = (Math.sin(polar) * 2 * Math.PI ** 2) / (width * height * split * split);
    for (let j = 0; j < width * split; j++) {
      const u = (j + 0.5) / split;
      const azimuth = 2 * Math.PI * (u / width - 0.5);
      let d = [Math.sin(azimuth) * Math.sin(polar), Math.cos(polar), -Math.cos(azimuth) * Math.sin(polar)];
      // Turned to the right, so that what is in front (+z) goes to the right (+x); then up, so that it goes up (+y).
      const [cy, sy, cp, sp] = [Math.cos(yaw * radians), Math.sin(yaw * radians), Math.cos(pitch * radians), Math.sin(pitch * radians)];
      d = [cy * d[0] + sy * d[2], d[1], -sy * d[0] + cy * d[2]];
      d = [d[0], cp * d[1] + sp * d[2], -sp * d[1] + cp * d[2]];
      const cosine = dot(normal, d);
      if (cosine <= 0) continue;
      const h = unit([d[0], d[1], d[2] + 1]);
      const thetaH = 2 * Math.asin(Math.min(1, 0.5 * Math.hypot(h[0] - normal[0], h[1] - normal[1], h[2] - normal[2])));
      const thetaD = Math.acos(Math.min(1, h[2]));
      const a = Math.min(Math.sqrt(thetaH / (Math.PI / 2)) * 90, 89);
      const b = Math.min(thetaD / radians, 89);
      const [m, n] = [Math.min(Math.floor(a), 88), Math.min(Math.floor(b), 88)];
      const c = Math.floor(u - 0.5);
      const r = Math.max(0, Math.min(Math.floor(v - 0.5), height - 2));
      const [s, t] = [u - 0.5 - c, Math.max(0, Math.min(1, v - 0.5 - r))];
      for (let k = 0; k < 3; k++) {
        const f = (p, q) => table[3 * ((m + p) * 90 + n + q) + k];
        const l = (p, q) => rgb[3 * ((r + p) * width + ((c + q + width) % width)) + k];
        const bilinear = (g, p, q) => (1 - p) * ((1 - q) * g(0, 0) + q * g(0, 1)) + p * ((1 - q) * g(1, 0) + q * g(1, 1));
        sum[k] += bilinear(f, a - m, b - n) * bilinear(l, t, s) * cosine * area;
      }
    }
  }
  return sum;
}

async function numbers(browser) {
  const { page, faults, close } = await open(browser, { width: 320 });
  const data = await page.evaluate(() => JSON.parse(document.getElementById("sphere-data").textContent));
  const index = (list, name) => data[list].findIndex((entry) => entry.name === name);
  const show = async (material, light, [right, up]) => {
    await page.evaluate(([m, l]) => { viewer.setMaterial(m); viewer.setLight(l); }, [index("materials", material), index("lights", light)]);
    await page.locator("canvas").focus();
    await page.keyboard.press("Home");
    for (let i = 0; i < Math.abs(right) / 5; i++) await page.keyboard.press(right > 0 ? "ArrowRight" : "ArrowLeft");
    for (let i = 0; i < Math.abs(up) / 5; i++) await page.keyboard.press(up > 0 ? "ArrowUp" : "ArrowDown");
    await settle(page, 512);
  };
  const read = (points) => page.evaluate((points) => points.map(([x, y]) => viewer.readRadiance(x, y)), points);

  const disc = [];
  for (let x = -0.95; x < 1; x += 0.1) for (let y = -0.95; y < 1; y += 0.1) if (Math.hypot(x, y) < 0.99) disc.push([x, y]);
  await show("white Lambertian", "even", [0, 0]);
  const even = (await read(disc)).flat().map((r) => Math.abs(r - 1));
  check("a white Lambertian sphere in even light is 1", Math.max(...even) < 0.01, `off by ${Math.max(...even).toExponential(1)} at most`);

  const points = [[0, 0], [0.3, 0.2], [-0.3, 0.4], [0.5, -0.5], [-0.6, 0.1], [0.1, 0.75], [0.8, 0.2], [-0.2, -0.8], [-0.45, 0.45], [-0.85, 0.35]];
  for (const [material, light, turn, split, bound] of [
    ["lobe", "patch", [0, 0], 8, 0.03],
    ["lobe", "patch", [40, 25], 8, 0.03],
    ["lobe", "sun", [0, 0], 4, 0.03],
    ["glossy plastic", "studio", [-60, 15], 4, 0.03],
    ["satin metal", "studio", [0, 0], 4, 0.03],
    ["matte", "sun", [70, -20], 4, 0.03],
  ]) {
    await show(material, light, turn);
    const found = await read(points);
    const [m, l] = [data.materials[index("materials", material)], data.lights[index("lights", light)]];
    const errors = points.map((point, i) => {
      const right = integral(m, l, point, ...turn, split);
      return Math.max(...right.map((r, k) => Math.abs(found[i][k] - r) / r));
    });
    const worst = Math.max(...errors);
    check(`${material} in ${light} turned by ${turn.join(", ")} agrees with the sum over the light`, worst < bound,
      errors.map((e) => `${(100 * e).toFixed(2)} %`).join(" "));
  }
  // Chromium may print a stall when the test reads the accumulated picture.
  const told = faults.filter((text) => !/ReadPixels/.test(text));
  check("no complaints", told.length === 0, told.join("; "));
  await close();
}

const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: FLAGS });
try {
  for (const part of [looksAndUse, idle, phone, without, numbers]) await part(browser);
} finally {
  await browser.close();
}
console.log(failures === 0 ? "nothing wrong" : `${failures} checks failed`);
process.exit(failures === 0 ? 0 : 1);
