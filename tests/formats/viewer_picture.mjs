// usage: node viewer_picture.mjs NODE_MODULES BROWSER FILE.html OUT.png AZIMUTH,ELEVATION [LABEL=SHARE...]
//
// A picture of a .html result in a headless browser. LABEL=SHARE moves a slider, as "z shown up to=0.5".
import fs from 'node:fs';
import {createRequire} from 'node:module';
import path from 'node:path';
import {pathToFileURL} from 'node:url';

const [modules, executablePath, file, out, view, ...sliders] = process.argv.slice(2);
const puppeteer = createRequire(path.join(modules, 'x.js'))('puppeteer-core');
const browser = await puppeteer.launch({
  executablePath, headless: 'shell', args: ['--no-sandbox', '--enable-unsafe-swiftshader'], protocolTimeout: 300_000,
});
try {
  const page = await browser.newPage();
  await page.setViewport({width: 1000, height: 640});
  await page.goto(`${pathToFileURL(file)}#view=${view}`);
  await page.waitForSelector('#viewer[data-state=ready]', {timeout: 120_000});
  for (const [label, share] of sliders.map((slider) => slider.split('='))) {
    await page.$eval(`input[aria-label="${label}"]`, (input, part) => {
      input.value = Math.round(Number(part) * Number(input.max));
      input.dispatchEvent(new Event('input'));
    }, share);
  }
  await page.evaluate(() => window.viewer.still());
  fs.writeFileSync(out, await page.screenshot());
} finally {
  await browser.close();
}
