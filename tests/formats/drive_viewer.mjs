// usage: node drive_viewer.mjs NODE_MODULES BROWSER FILE.html PREFIX
//
// Opens a .html result from disk, uses the viewer as a person would, saves pictures as PREFIX-*.png, and prints what was
// seen as one JSON object.
import fs from 'node:fs';
import {createRequire} from 'node:module';
import path from 'node:path';
import {pathToFileURL} from 'node:url';

const [modules, executablePath, file, prefix] = process.argv.slice(2);
const puppeteer = createRequire(path.join(modules, 'x.js'))('puppeteer-core');
const browser = await puppeteer.launch({
  executablePath, headless: 'shell', args: ['--no-sandbox', '--enable-unsafe-swiftshader'], protocolTimeout: 300_000,
});
try {
  const page = await browser.newPage();
  const problems = [], requests = [];
  page.on('console', (message) => { if (message.type() === 'error') problems.push(message.text()); });
  page.on('pageerror', (error) => problems.push(error.message));
  page.on('request', (request) => { if (!/^(file|data|blob):/.test(request.url())) requests.push(request.url()); });
  await page.setViewport({width: 960 + 304, height: 960});
  await page.goto(`${pathToFileURL(file)}#view=30,20`);
  await page.waitForSelector('#viewer[data-state]', {timeout: 120_000});
  const state = await page.$eval('#viewer', (viewer) => ({...viewer.dataset, text: viewer.innerText}));
  const seen = {problems, requests, ...state};
  if (state.state === 'ready') {
    const canvas = await page.$('canvas');
    const shot = async (name, element = page) => {
      await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
      fs.writeFileSync(`${prefix}-${name}.png`, await element.screenshot());
    };
    await shot('view', canvas);
    const box = await canvas.boundingBox();
    await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
    await page.waitForFunction(() => document.querySelector('[role=status]').textContent.startsWith('voxel'),
      {timeout: 60_000}).catch(() => problems.push('nothing under the cursor'));
    seen.hover = await page.$eval('[role=status]', (status) => status.textContent);
    seen.corner = await page.evaluate(() => window.viewer.pick(2, 2));
    const slide = (label, value) => page.$eval(`input[aria-label="${label}"]`, (input, v) => {
      input.value = v;
      input.dispatchEvent(new Event('input'));
    }, value);
    const most = await page.$eval('input[aria-label="x shown up to"]', (input) => Number(input.max));
    await slide('x shown up to', Math.ceil(most / 2));
    await shot('slice', canvas);
    await slide('x shown up to', most);
    seen.choices = await page.$$eval('select option', (options) => options.map((option) => option.textContent));
    await page.select('select', '-1');
    await shot('plain', canvas);
    await canvas.focus();
    await page.keyboard.press('ArrowLeft');
    await shot('turned', canvas);
    seen.frame_ms = await page.evaluate(() => [0, 1, 2].map(() => window.viewer.frameMs()));
    await page.setViewport({width: 390, height: 844});
    await shot('phone');
    seen.too_wide = await page.evaluate(() => document.documentElement.scrollWidth > window.innerWidth);
  }
  console.log(JSON.stringify(seen));
} finally {
  await browser.close();
}
