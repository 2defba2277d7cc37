// usage: node drive_page.mjs NODE_MODULES BROWSER URL MESH FOLDER [TOKEN]
//
// Uses the server's page as a person would: chooses a mesh and two targets, voxelizes, turns to the result, downloads
// it in every format into FOLDER, cancels a large job. Saves pictures there, and prints what was seen as one JSON
// object.
import fs from 'node:fs';
import {createRequire} from 'node:module';
import path from 'node:path';

const [modules, executablePath, url, mesh, folder, token] = process.argv.slice(2);
const puppeteer = createRequire(path.join(modules, 'x.js'))('puppeteer-core');
const browser = await puppeteer.launch({
  executablePath, headless: 'shell', args: ['--no-sandbox', '--enable-unsafe-swiftshader'], protocolTimeout: 300_000,
});
const seen = {problems: [], foreign: [], files: {}, focus: [], calls: []};
try {
  const page = await browser.newPage();
  page.on('pageerror', (error) => seen.problems.push(error.message));
  page.on('console', (message) => {
    if (/Content.Security.Policy|is not a/.test(message.text())) seen.problems.push(message.text());
  });
  page.on('request', (request) => {
    if (!request.url().startsWith(url) && !/^(data|blob):/.test(request.url())) seen.foreign.push(request.url());
  });
  const calls = []; // names of methods, and "file"
  page.on('request', (request) => {
    if (request.method() === 'POST') calls.push(new URL(request.url()).pathname.split('/').pop());
  });
  const text = (id) => page.$eval(`#${id}`, (element) => element.textContent);
  const setAt = (selector, value) => page.$eval(selector, (element, v) => {
    element.value = v;
    element.dispatchEvent(new Event('change', {bubbles: true}));
  }, value);
  const set = (id, value) => setAt(`#${id}`, value);
  const setTarget = async (n, parts) => {
    for (const [part, value] of Object.entries(parts)) {
      await setAt(`.target:nth-child(${n + 1}) [name="${part}"]`, value);
    }
  };
  const state = async (...wanted) => {
    await page.waitForFunction((states) => states.includes(document.getElementById('form').dataset.state),
      {timeout: 120_000}, wanted);
    return page.$eval('#form', (form) => form.dataset.state);
  };
  const shot = async (name) => fs.writeFileSync(path.join(folder, `${name}.png`), await page.screenshot());

  await page.setViewport({width: 1280, height: 900});
  await page.goto(url);
  if (token) {
    await page.waitForFunction(() => document.getElementById('error').textContent !== '', {timeout: 30_000});
    seen.without_token = await text('error');
    seen.token_focused = await page.evaluate(() => document.activeElement.id === 'token');
    await set('token', `not-${token}`);
    await page.waitForFunction((before) => document.getElementById('error').textContent !== before, {timeout: 30_000},
      seen.without_token);
    seen.wrong_token = await text('error');
    await set('token', token);
  }
  await page.waitForFunction(() => document.getElementById('server').textContent.startsWith('version'),
    {timeout: 30_000});
  await page.focus('body');
  for (let i = 0; i < 16 && !token; ++i) { // with a token the focus is in its field
    await page.keyboard.press('Tab');
    seen.focus.push(await page.evaluate(() => document.activeElement.id || document.activeElement.name));
  }
  await (await page.$('#file')).uploadFile(mesh);
  await set('resolution', '48');
  await set('fill', 'FILL_PARITY');
  for (let n = 0; n < 2; ++n) await page.$eval('#add', (button) => button.click());
  await setTarget(0, {shader: 'occupancy', format: 'VOXEL_FORMAT_BIT', blend: 'BLEND_OR'});
  await setTarget(1, {shader: 'normal', format: 'VOXEL_FORMAT_F32', blend: 'BLEND_AVERAGE'});
  await page.waitForFunction(() => document.getElementById('plan').textContent !== '', {timeout: 30_000});
  seen.plan = await text('plan');
  await page.click('#run');
  seen.state = await state('done', 'failed');
  seen.error = await text('error');
  seen.summary = await text('summary');
  seen.calls = calls.slice(calls.indexOf('CreateMesh')).filter((name) => name !== 'EstimateVoxelization');
  if (await page.$('#voxels canvas')) {
    seen.faces = await page.$eval('#voxels', (element) => element.dataset.faces);
    await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  }
  await shot('page-desktop');
  await page.setViewport({width: 390, height: 844});
  await shot('page-phone');
  seen.too_wide = await page.evaluate(() => document.documentElement.scrollWidth > window.innerWidth);
  await page.setViewport({width: 1280, height: 900});

  const session = await browser.target().createCDPSession();
  await session.send('Browser.setDownloadBehavior', {behavior: 'allow', downloadPath: folder});
  for (const name of await page.$$eval('#as option', (options) => options.map((option) => option.value))) {
    await set('as', name);
    const files = ['', '.zip'].map((end) => path.join(folder, `${path.parse(mesh).name}.${name}${end}`));
    const arrived = () => files.some((file) => fs.existsSync(file));
    seen.files[name] = '';
    // Chromium drops the eleventh download of a page, and takes the next: a person clicks again.
    for (let click = 0; seen.files[name] === '' && !arrived() && click < 2; ++click) {
      await page.click('#download');
      await page.waitForFunction(() => !document.getElementById('download').disabled, {timeout: 60_000});
      seen.files[name] = await text('error');
      for (let i = 0; seen.files[name] === '' && !arrived() && i < 100; ++i) {
        await new Promise((done) => setTimeout(done, 50));
      }
    }
  }

  // Each mesh of the file is a part.
  await set('parts', 'PART_SCOPE_MESH');
  seen.fills_of_parts = await page.$$eval('#fill option', (all) => all.filter((o) => !o.disabled).map((o) => o.value));
  await setTarget(1, {shader: 'label', format: 'VOXEL_FORMAT_U16', blend: 'BLEND_REPLACE'});
  await page.$eval('#form', (form) => { form.dataset.state = ''; });
  await page.click('#run');
  seen.state_of_parts = await state('done', 'failed');
  seen.parts = await page.$$eval('.voxels-labels li', (lines) => lines.map((line) => line.textContent));
  await set('parts', 'PART_SCOPE_WHOLE');
  await set('resolution', '1500');
  await set('fill', 'FILL_NONE');
  await setTarget(1, {format: 'VOXEL_FORMAT_U8'});
  // Neither a fast machine nor a fast network ends the run before the click.
  await page.emulateNetworkConditions({download: 1024, upload: 1 << 20, latency: 0});
  await page.click('#run');
  await state('running');
  await page.waitForFunction(() => document.getElementById('stage').textContent !== 'done', {timeout: 30_000});
  await page.click('#cancel');
  seen.after_cancel = await state('cancelled', 'done', 'failed');
  console.log(JSON.stringify(seen));
} finally {
  await browser.close();
}
