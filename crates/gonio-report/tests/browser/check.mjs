// Opens a report by file://. Fails if the page prints to the console, lacks a picture, requests another file, or is wider
// than a screen or a phone.
//
//     node check.mjs REPORT.html [SCREENSHOT.png]
//
// The screenshot is of the whole page at the width of a screen; SCREENSHOT-phone.png and SCREENSHOT-dark.png lie beside it.
// CHROMIUM names the browser, /usr/bin/chromium otherwise.
import { existsSync } from "node:fs";
import { resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";
import { FLAGS } from "./flags.mjs";

const VIEWS = [
  { name: "", width: 1280, height: 900, colorScheme: "light" },
  { name: "-dark", width: 1280, height: 900, colorScheme: "dark" },
  { name: "-phone", width: 390, height: 844, colorScheme: "light" },
];

const [report, screenshot] = process.argv.slice(2);
if (!report || !existsSync(report)) {
  console.error(report ? `${report}: no such file` : "usage: node check.mjs REPORT.html [SCREENSHOT.png]");
  process.exit(2);
}
const url = pathToFileURL(resolve(report)).href;
const faults = [];

async function look(browser, { name, width, height, colorScheme }) {
  const fault = (text) => faults.push(`at ${width} pixels, ${colorScheme}: ${text}`);
  const context = await browser.newContext({ viewport: { width, height }, colorScheme });
  const page = await context.newPage();
  page.on("console", (message) => {
    if (["error", "warning"].includes(message.type())) fault(`console ${message.type()}: ${message.text()}`);
  });
  page.on("pageerror", (error) => fault(`error: ${error.message}`));
  page.on("requestfailed", (request) => fault(`failed: ${request.url().slice(0, 100)}`));
  page.on("request", (request) => {
    const asked = request.url();
    if (asked.split("#")[0] !== url && !asked.startsWith("data:")) fault(`asks for ${asked.slice(0, 100)}`);
  });
  await page.goto(url, { waitUntil: "load" });
  const found = await page.evaluate(async () => {
    const images = [...document.images];
    await Promise.all(images.map((image) => image.decode().catch(() => {})));
    const root = document.documentElement;
    // Elements inside a scrolling element may have any width.
    const scrolls = (e) => e && e !== document.body && (getComputedStyle(e).overflowX !== "visible" || scrolls(e.parentElement));
    const wide = [...document.body.querySelectorAll("*")].filter(
      (e) => !e.closest("svg svg, svg *") && e.getBoundingClientRect().right > root.clientWidth + 0.5 && !scrolls(e.parentElement),
    );
    return {
      images: images.length,
      broken: images.filter((i) => !i.complete || i.naturalWidth === 0).map((i) => i.alt),
      wordless: images.filter((i) => !i.alt.trim()).length,
      headings: document.querySelectorAll("h1").length,
      over: root.scrollWidth - root.clientWidth,
      wide: wide.slice(0, 5).map((e) => `<${e.tagName.toLowerCase()} class="${e.className}">`),
    };
  });
  for (const alt of found.broken) fault(`a picture is broken: ${alt}`);
  if (found.wordless > 0) fault(`${found.wordless} pictures have no alt text`);
  if (found.headings !== 1) fault(`${found.headings} main headings`);
  if (found.over > 0) fault(`the page is ${found.over} pixels too wide: ${found.wide.join(", ")}`);
  else if (found.wide.length > 0) fault(`cut off at the right: ${found.wide.join(", ")}`);
  if (screenshot) await page.screenshot({ path: screenshot.replace(/(\.png)?$/, `${name}.png`), fullPage: true });
  await context.close();
  return found.images;
}

const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: FLAGS });
let images = 0;
try {
  for (const view of VIEWS) images = await look(browser, view);
} finally {
  await browser.close();
}
for (const text of faults) console.error(`${report} ${text}`);
if (faults.length > 0) process.exit(1);
console.log(`${report}: ${images} pictures, nothing wrong at ${VIEWS.map((v) => v.width).join(", ")} pixels`);
