// Opens a report.html of `gonio infer` as a reader would: with the keyboard, by a screen reader's rules, on a phone.
//
//     node report.mjs REPORT.html [FOLDER_FOR_SCREENSHOTS]
//
// CHROMIUM names the browser, /usr/bin/chromium otherwise.
import { existsSync, readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";
import { FLAGS } from "./flags.mjs";

const [report, shots] = process.argv.slice(2);
if (!report || !existsSync(report)) {
  console.error(report ? `${report}: no such file` : "usage: node report.mjs REPORT.html [FOLDER_FOR_SCREENSHOTS]");
  process.exit(2);
}
const url = pathToFileURL(resolve(report)).href;
const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
let failures = 0;

function check(name, passed, found = "") {
  if (!passed) failures++;
  console.log(`${passed ? "ok  " : "FAIL"} ${name}${found === "" ? "" : `: ${found}`}`);
}

const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: FLAGS });
try {
  for (const [name, width, height, colorScheme] of [["screen", 1280, 900, "light"], ["phone", 390, 844, "dark"]]) {
    const context = await browser.newContext({ viewport: { width, height }, colorScheme, permissions: ["clipboard-read", "clipboard-write"] });
    const page = await context.newPage();
    const faults = [];
    page.on("pageerror", (error) => faults.push(error.message));
    page.on("console", (message) => ["error", "warning"].includes(message.type()) && faults.push(message.text()));
    page.on("request", (request) => {
      const asked = request.url();
      if (asked.split("#")[0] !== url && !asked.startsWith("data:")) faults.push(`asks for ${asked.slice(0, 100)}`);
    });
    await page.goto(url, { waitUntil: "load" });

    check(`${name}: the sphere is drawn`, await page.evaluate(() => gonioSphere.ready));
    const centre = await page.evaluate(async () => {
      while (gonioSphere.samples < 12) await new Promise((later) => setTimeout(later, 50));
      return [...gonioSphere.readRadiance(0.1, 0.1)];
    });
    check(`${name}: it is lit`, centre.slice(0, 3).every((v) => Number.isFinite(v) && v > 0), centre.map((v) => v.toFixed(3)).join(" "));

    // By keyboard alone: the sphere can be reached and turned, the light chosen.
    const reached = [];
    for (let i = 0; i < 60; i++) {
      await page.keyboard.press("Tab");
      const at = await page.evaluate(() => document.activeElement.tagName);
      reached.push(at);
      if (at === "CANVAS") break;
    }
    check(`${name}: the Tab key reaches the sphere`, reached.at(-1) === "CANVAS", `${reached.length} presses`);
    await page.keyboard.press("ArrowRight");
    const status = page.locator("#sphere [role=status]");
    await page.waitForFunction(() => document.querySelector("#sphere [role=status]").textContent.includes("turned"));
    check(`${name}: arrow keys turn the light and say so`, /turned 5° to the right/.test(await status.textContent()), await status.textContent());
    for (let i = 0; i < 4; i++) {
      await page.keyboard.press("Tab");
      if ((await page.evaluate(() => document.activeElement.closest("label")?.textContent ?? "")).startsWith("Light")) break;
    }
    await page.keyboard.press("ArrowDown");
    const label = await page.locator("#sphere canvas").getAttribute("aria-label");
    check(`${name}: the light is chosen by keys and named`, /Light: (?!studio)/.test(label), label);

    // The button copies the text.
    const source = page.locator("pre#mitsuba");
    await page.locator("button[data-copy=mitsuba]").click();
    await page.waitForFunction(() => document.querySelector("button[data-copy=mitsuba]").textContent !== "Copy");
    const copied = await page.evaluate(() => navigator.clipboard.readText()).catch((error) => error.message);
    check(`${name}: parameters are copied`, copied === (await source.textContent()) && copied.includes("principled"), copied.slice(0, 40).replaceAll("\n", " "));

    // Folded parts are checked as well.
    await page.evaluate(() => document.querySelectorAll("details").forEach((part) => (part.open = true)));
    await page.evaluate(axe);
    const { violations } = await page.evaluate(() => axe.run(document, { runOnly: ["wcag2a", "wcag2aa", "wcag21aa", "best-practice"] }));
    const said = violations.map((v) => `${v.id} (${v.nodes.length}: ${v.nodes[0].html.slice(0, 80)})`);
    check(`${name}: axe finds nothing`, said.length === 0, said.join("; "));
    const over = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
    check(`${name}: nothing is too wide`, over <= 0, `${over} pixels over`);
    if (shots) await page.screenshot({ path: join(shots, `report-${name}.png`), fullPage: true });
    check(`${name}: nothing on the console, nothing asked for`, faults.length === 0, faults.join("; "));
    await context.close();
  }

  // Without scripts the pictures are there, and a word in place of the sphere.
  const context = await browser.newContext({ javaScriptEnabled: false });
  const page = await context.newPage();
  await page.goto(url);
  check("without scripts: says what is missing", (await page.locator("#sphere").textContent()).includes("requires JavaScript"));
  check("without scripts: pictures are shown", (await page.locator("img").count()) >= 10);
  await context.close();
} finally {
  await browser.close();
}
console.log(failures === 0 ? "nothing wrong" : `${failures} wrong`);
process.exit(failures === 0 ? 0 : 1);
