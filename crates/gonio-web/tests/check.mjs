// Drops a photograph on the page of gonio-web in a browser, opened by file://. Fails if the result is late, wrong or incomplete, if the
// page requests anything or writes to the console, or if it is too large or too wide.
//
//     node check.mjs PAGE.html PHOTOGRAPH.exr [NATIVE.binary] [SCREENSHOT.png]
//
// NATIVE.binary is the result of `gonio infer` for the same photograph. CHROMIUM is the browser, by default /usr/bin/chromium. The script
// uses the packages of gonio-report: run `npm ci` in crates/gonio-report/tests/browser first.
import { readFile, readFileSync, statSync } from "node:fs";
import { createServer } from "node:http";
import { createRequire } from "node:module";
import { basename, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const REPORT = new URL("../../gonio-report/tests/browser/", import.meta.url);
const { chromium } = createRequire(REPORT)("playwright-core");
const axe = readFileSync(createRequire(REPORT).resolve("axe-core/axe.min.js"), "utf8");
const { FLAGS } = await import(new URL("flags.mjs", REPORT));

// 8.2 MB, half of it for the model.
const MOST_BYTES = 8.4e6;
const MOST_SECONDS = 20;
const TOLERANCE = 1e-3; // relative deviation of a trusted cell from the result of the program
const LATEST = 180e3; // for the whole run on a slow machine, ms

const [html, photograph, native, screenshot] = process.argv.slice(2);
if (!html || !photograph) {
  console.error("usage: node check.mjs PAGE.html PHOTOGRAPH.exr [NATIVE.binary] [SCREENSHOT.png]");
  process.exit(2);
}
const url = pathToFileURL(resolve(html)).href;
const faults = [];
const fault = (text) => faults.push(text);
const check = (holds, text) => holds || fault(text);

/** Opens a page and reports unwanted requests, console output and errors. */
async function open(browser, view, address = url) {
  const context = await browser.newContext({ viewport: view, colorScheme: view.colorScheme ?? "light", acceptDownloads: true });
  const page = await context.newPage();
  page.setDefaultTimeout(LATEST);
  // The software renderer prints messages about its speed.
  const ownRemark = (text) => text.includes("GPU stall due to ReadPixels") || text.includes("GL Driver Message");
  page.on("console", (message) => {
    if (!ownRemark(message.text())) fault(`console ${message.type()}: ${message.text().slice(0, 300)}`);
  });
  page.on("pageerror", (error) => fault(`error: ${error.message}`));
  context.on("request", (request) => {
    const asked = request.url();
    if (asked !== address && !/^(data|blob):/.test(asked)) fault(`requests ${asked.slice(0, 100)}`);
  });
  await page.goto(address, { waitUntil: "load" });
  return page;
}

/** Drops a file as a user does: enter, over, drop. Some browsers expose the file only on drop. */
async function drop(page, name, bytes) {
  const transfer = await page.evaluateHandle(([name, text]) => {
    const transfer = new DataTransfer();
    transfer.items.add(new File([Uint8Array.from(atob(text), (c) => c.charCodeAt(0))], name));
    return transfer;
  }, [name, bytes.toString("base64")]);
  const start = performance.now();
  for (const type of ["dragenter", "dragover", "drop"]) await page.dispatchEvent("#drop", type, { dataTransfer: transfer });
  return () => (performance.now() - start) / 1000;
}

const isDrawn = () => document.documentElement.dataset.viewer === "drawn" && !document.querySelector("#words").hidden;
const isFinished = () => !document.querySelector("#downloads").hidden;

async function keep(page, name) {
  const [download] = await Promise.all([page.waitForEvent("download"), page.click(`[data-product="${name}"]`)]);
  check(download.suggestedFilename() === name, `the download of ${name} is called ${download.suggestedFilename()}`);
  return readFileSync(await download.path());
}

/** The largest relative difference of two MERL files over the cells with both angles below 80 degrees. */
function difference(a, b) {
  const [H, D, P] = [90, 90, 180];
  if (a.length !== b.length) return Infinity;
  const [x, y] = [a, b].map((bytes) => new Float64Array(bytes.buffer.slice(bytes.byteOffset + 12, bytes.byteOffset + bytes.length)));
  let most = 0;
  for (let i = 0; i < x.length; i++) {
    const cell = Math.floor(i / P);
    const [h, d] = [Math.floor(cell / D) % H, cell % D];
    if ((h / H) ** 2 * 90 >= 80 || d >= 80) continue;
    const change = Math.abs(x[i] - y[i]) / Math.max(Math.abs(y[i]), 1e-12);
    if (!(change <= most)) most = change;
  }
  return most;
}

/** Checks that nothing is wider than the window, that all values and alternative texts exist, and that axe reports no violations. */
async function layout(page, name) {
  const found = await page.evaluate(() => ({
    over: document.documentElement.scrollWidth - document.documentElement.clientWidth,
    wordless: [...document.images].filter((i) => i.checkVisibility() && (!i.alt.trim() || !i.naturalWidth)).length,
    nameless: [...document.querySelectorAll("button, input, select")].filter((e) => {
      return e.checkVisibility() && !e.textContent.trim() && !e.labels?.length && !e.ariaLabel;
    }).length,
    unset: document.body.innerText.match(/.{0,40}\b(NaN|undefined)\b.{0,20}/)?.[0],
  }));
  check(!found.unset, `${name}: a value is missing in "${found.unset}"`);
  check(found.over <= 0, `${name}: ${found.over} pixels too wide`);
  check(found.wordless === 0, `${name}: ${found.wordless} images that are broken or have no alternative text`);
  check(found.nameless === 0, `${name}: ${found.nameless} controls without a name`);
  await page.evaluate(axe);
  const { violations } = await page.evaluate(() => axe.run(document, { runOnly: ["wcag2a", "wcag2aa", "wcag21aa", "best-practice"] }));
  for (const v of violations) fault(`${name}: axe: ${v.id} (${v.nodes.length}: ${v.nodes[0].html.slice(0, 100)})`);
  if (screenshot) await page.screenshot({ path: screenshot.replace(/(\.png)?$/, `-${name}.png`), fullPage: true });
}

const bytes = readFileSync(photograph);
const size = statSync(html).size;
check(size < MOST_BYTES, `the page has ${size} bytes`);
const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: FLAGS });
try {
  // Drops a photograph and checks all events up to the last download.
  const page = await open(browser, { width: 1280, height: 900 });
  await layout(page, "empty");
  const since = await drop(page, basename(photograph), bytes);
  await page.waitForFunction(isDrawn);
  const first = since();
  await layout(page, "first");
  check(first < MOST_SECONDS, `the first result came after ${first.toFixed(1)} s`);
  await page.waitForFunction(isFinished);
  const last = since();
  await page.waitForFunction(isDrawn);
  await page.click("#cells summary");
  await layout(page, "finished");
  const steps = await page.$$eval("#steps li", (list) => list.map((li) => `${li.firstChild.textContent} ${li.lastChild.textContent}`));
  console.log(`page ${(size / 1e6).toFixed(1)} MB; first result ${first.toFixed(1)} s, all ${last.toFixed(1)} s: ${steps.join("; ")}`);
  const merl = await keep(page, "brdf.binary");
  check(merl.length === 12 + 3 * 90 * 90 * 180 * 8, `brdf.binary has ${merl.length} bytes`);
  if (native) {
    const most = difference(merl, readFileSync(native));
    console.log(`largest relative difference from the program over the trusted cells: ${most.toExponential(1)}`);
    check(most <= TOLERANCE, `brdf.binary differs from ${native} by ${most}`);
  }
  check((await keep(page, "brdf_rgb.bsdf")).subarray(0, 12).toString() === "tensor_file\0", "brdf_rgb.bsdf is not a tensor file");
  check((await keep(page, "light.exr")).readUInt32LE(0) === 20000630, "light.exr is not an OpenEXR file");
  const result = JSON.parse(await keep(page, "result.json"));
  // Dragging the outline restarts the inference, and the displayed command contains the new outline.
  const command = () => page.textContent("#photograph code");
  const outline = page.locator(".stage circle");
  await outline.scrollIntoViewIfNeeded();
  const [told, circle] = [await command(), await outline.boundingBox()];
  check(told.startsWith(`gonio infer '${basename(photograph)}' --circle `), `the command is ${told}`);
  const [x, y] = [circle.x + circle.width / 2, circle.y + circle.height / 2];
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 3, y, { steps: 3 });
  await page.mouse.up();
  await page.waitForFunction((told) => document.querySelector("#photograph code").textContent !== told, told);
  await page.waitForFunction(isFinished);
  const moved = [told, await command()].map((text) => Number(text.match(/--circle ([\d.]+)/)[1]));
  check(moved[1] > moved[0], `dragging to the right moved the circle from ${moved[0]} to ${moved[1]}`);
  check(result.format === "gonio-result" && result.settings.grid === 32 && result.seconds.material > 0, "result.json is incomplete");
  await page.context().close();

  // The page also works on a phone, in dark mode and from a server, with the sample after invalid files.
  const served = createServer((_, response) => readFile(html, (_, data) => response.setHeader("content-type", "text/html").end(data)));
  await new Promise((listening) => served.listen(0, "127.0.0.1", listening));
  const address = `http://127.0.0.1:${served.address().port}/`;
  const phone = await open(browser, { width: 390, height: 844, colorScheme: "dark" }, address);
  await drop(phone, "broken.exr", bytes.subarray(0, 5000));
  await phone.waitForSelector("#trouble:not([hidden])");
  const broken = await phone.textContent("#trouble p");
  check(/^broken\.exr: .{10}/.test(broken), `unexpected message for a damaged file: ${broken}`);
  await layout(phone, "trouble");
  await drop(phone, "notes.txt", Buffer.from("not a picture"));
  await phone.waitForFunction(() => document.querySelector("#trouble").textContent.includes("notes.txt"));
  // For an image without a ball (a grey ramp as PFM), the page requests the outline.
  const ramp = Buffer.alloc(3 * 64 * 64 * 4);
  for (let i = 0; i < 3 * 64 * 64; i++) ramp.writeFloatLE(0.2 + ((Math.floor(i / 3) * 37) % 101) / 100, 4 * i);
  await drop(phone, "ramp.pfm", Buffer.concat([Buffer.from("PF\n64 64\n-1\n"), ramp]));
  await phone.waitForSelector("#outline:not([hidden])");
  await layout(phone, "outline");
  await phone.click("#outline button");
  await phone.waitForFunction(isFinished);
  await phone.evaluate(() => delete document.documentElement.dataset.viewer);
  await phone.focus("#sample");
  await phone.keyboard.press("Enter");
  await phone.waitForFunction(() => document.querySelector("#photograph figcaption").textContent.startsWith("ball.exr"));
  await phone.waitForFunction(isFinished);
  await phone.waitForFunction(isDrawn);
  await layout(phone, "phone");
  served.close();
} finally {
  await browser.close();
}
for (const text of faults) console.error(`${html}: ${text}`);
if (faults.length > 0) process.exit(1);
console.log(`${html}: nothing wrong`);
