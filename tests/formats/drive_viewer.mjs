// usage: node drive_viewer.mjs NODE_MODULES BROWSER FILE.html PREFIX
//
// Opens a .html result from disk, uses the viewer as a person would, saves pictures as PREFIX-*.png, and prints what was
// seen as one JSON object.
import fs from 'node:fs';
import {createRequire} from 'node:module';
import path from 'node:path';
import {pathToFileURL} from 'node:url';

// The least contrast of a text of the panel to its background (W3C, Web Content Accessibility Guidelines 2.1, 2018).
function leastContrast() {
  const numbers = (colour) => colour.match(/[\d.]+/g).map(Number);
  const luminance = (colour) => {
    const [r, g, b] = numbers(colour).map((v) => (v <= 10.31 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const behind = (element) => {
    const colour = getComputedStyle(element).backgroundColor;
    return numbers(colour)[3] === 0 ? behind(element.parentElement) : colour;
  };
  const texts = [...document.querySelectorAll('.voxels-panel *')].filter((element) => element.checkVisibility() &&
    (element.tagName === 'SELECT' || [...element.childNodes].some((n) => n.nodeType === 3 && n.data.trim() !== '')));
  return Math.min(...texts.filter((element) => element.tagName !== 'OPTION').map((element) => {
    const [a, b] = [luminance(getComputedStyle(element).color), luminance(behind(element))];
    return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
  }));
}

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
      await page.evaluate(() => window.viewer.still());
      fs.writeFileSync(`${prefix}-${name}.png`, await element.screenshot());
    };
    await shot('view', canvas);
    const box = await canvas.boundingBox();
    await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
    await page.waitForFunction(() => document.querySelector('[role=status]').textContent.startsWith('voxel'),
      {timeout: 60_000}).catch(() => problems.push('nothing under the cursor'));
    const hex = (colour) => `#${colour.match(/\d+/g).map((n) => Number(n).toString(16).padStart(2, '0')).join('')}`;
    seen.labels = await page.$$eval('.voxels-labels li', (lines) => lines.map((line) => [line.textContent,
      getComputedStyle(line.querySelector('.voxels-bar')).display,
      getComputedStyle(line.querySelector('.voxels-bar')).backgroundColor]));
    seen.labels = seen.labels.map(([text, shown, colour]) => [text, shown !== 'none', hex(colour)]);
    seen.hover = await page.$eval('[role=status]', (status) => status.textContent);
    seen.corner = await page.evaluate(() => window.viewer.pick(2, 2));
    const slide = (label, value) => page.$eval(`input[aria-label="${label}"]`, (input, v) => {
      input.value = v;
      input.dispatchEvent(new Event('input'));
    }, value);
    const most = await page.$$eval('input[type=range]', (inputs) => inputs.map((input) => Number(input.max)));
    await slide('x shown up to', Math.ceil(most[1] / 2));
    await shot('slice', canvas);
    await slide('x shown up to', most[1]);
    // A cut of each side, seen from there: what lies under points of the picture.
    const views = [[-60, 20], [60, 20], [30, -60], [30, 60], [150, 20], [30, 20]];
    const across = Number(state.faces) < 100_000 ? 32 : 4;
    seen.cuts = [];
    for (const [side, view] of views.entries()) {
      const name = 'xyz'[side >> 1], size = most[side | 1];
      const [label, at, back] = side % 2 ? [`${name} shown up to`, Math.floor(0.4 * size), size]
        : [`first ${name} shown`, Math.floor(0.6 * size), 0];
      await slide(label, at);
      await page.evaluate((azimuth, elevation) => window.viewer.setView(azimuth, elevation), ...view);
      await shot(`cut${side}`, canvas);
      const points = await page.evaluate((n, width, height) => Array.from({length: n * n}, (_, i) => {
        const [x, y] = [(i % n + 0.5) / n * width, (Math.floor(i / n) + 0.5) / n * height].map(Math.floor);
        return [x, y, window.viewer.pick(x + 0.5, y + 0.5)];
      }), across, box.width, box.height);
      const legend = await page.$eval('.voxels-cut', (line) => (line.hidden ? '' : line.textContent));
      await slide(label, back);
      seen.cuts.push({layer: side % 2 ? at - 1 : at, points, legend});
    }
    seen.contrast = [];
    for (const scheme of ['dark', 'light']) {
      await page.emulateMediaFeatures([{name: 'prefers-color-scheme', value: scheme}]);
      seen.contrast.push(await page.evaluate(leastContrast));
      if (scheme === 'dark') await shot('dark');
    }
    seen.legend = await page.$eval('.voxels-cut', (line) => (line.hidden ? '' : line.textContent));
    await page.evaluate(() => window.viewer.setView(30, 20));
    seen.choices = await page.$$eval('select option', (options) => options.map((option) => option.textContent));
    await page.select('select', '-1');
    await shot('plain', canvas);
    await canvas.focus();
    await page.keyboard.press('ArrowLeft');
    await shot('turned', canvas);
    seen.frame_ms = await page.evaluate(() => [2, 0.5].map((ratio) =>
      Math.min(...[0, 1, 2].map(() => window.viewer.frameMs(ratio)))));
    await page.setViewport({width: 390, height: 844});
    await shot('phone');
    seen.too_wide = await page.evaluate(() => document.documentElement.scrollWidth > window.innerWidth);
  }
  console.log(JSON.stringify(seen));
} finally {
  await browser.close();
}
