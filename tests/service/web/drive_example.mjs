// usage: node drive_example.mjs NODE_MODULES BROWSER URL METRICS FOLDER
//
// Uses the server's page as a first visitor would: tries the example, changes two options, voxelizes again, downloads
// two files into FOLDER. Then options that do not go together, and a mesh that is dropped. Saves pictures and the
// example there, and prints what was seen as one JSON object, with the server's own counts at METRICS.
import fs from 'node:fs';
import {createRequire} from 'node:module';
import path from 'node:path';

const [modules, executablePath, url, metrics, folder] = process.argv.slice(2);
const puppeteer = createRequire(path.join(modules, 'x.js'))('puppeteer-core');
const browser = await puppeteer.launch({
  executablePath, headless: 'shell', args: ['--no-sandbox', '--enable-unsafe-swiftshader'], protocolTimeout: 300_000,
});
const SIZES = {desktop: {width: 1280, height: 720}, phone: {width: 390, height: 844}};
const seen = {problems: [], calls: [], runs: [], in_sight: {}, too_wide: {}, shown: []};

// The server's own count of this name.
async function count(name) {
  const text = await (await fetch(metrics)).text();
  return Number(new RegExp(`^${name} (\\S+)$`, 'm').exec(text)?.[1]);
}
const runs = () => count('voxelpipe_job_seconds_count');

try {
  const page = await browser.newPage();
  page.on('pageerror', (error) => seen.problems.push(error.message));
  page.on('console', (message) => {
    if (/Content.Security.Policy|is not a/.test(message.text())) seen.problems.push(message.text());
  });
  page.on('request', (request) => {
    if (request.method() === 'POST') seen.calls.push(new URL(request.url()).pathname.split('/').pop());
  });
  const text = (id) => page.$eval(`#${id}`, (element) => element.textContent);
  const set = (id, value) => page.$eval(`#${id}`, (element, v) => {
    element.value = v;
    element.dispatchEvent(new Event('change', {bubbles: true}));
  }, value);
  const settled = async () => {
    await page.waitForFunction(() => ['done', 'failed'].includes(document.getElementById('form').dataset.state),
      {timeout: 120_000});
    if (await text('error') !== '') seen.problems.push(await text('error'));
    await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  };
  const shot = async (name) => fs.writeFileSync(path.join(folder, `${name}.png`), await page.screenshot());
  // A person scrolls to a button that the bar of actions covers.
  const press = (selector) => page.$eval(selector, (button) => button.click());
  const inSight = (id) => page.$eval(`#${id}`, (element) => {
    const box = element.getBoundingClientRect();
    const top = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
    return top === element && box.top >= 0 && box.bottom <= window.innerHeight;
  });
  const tooWide = () => page.evaluate(() => document.documentElement.scrollWidth > window.innerWidth);
  const session = await browser.target().createCDPSession();
  await session.send('Browser.setDownloadBehavior', {behavior: 'allow', downloadPath: folder});

  for (const size of ['phone', 'desktop']) {
    await page.setViewport(SIZES[size]);
    await page.goto(url);
    await page.waitForFunction(() => document.getElementById('server').textContent.startsWith('version'),
      {timeout: 30_000});
    seen.in_sight[size] = {};
    for (const open of [false, true]) {
      await page.$eval('#options', (options, to) => { options.open = to; }, open);
      seen.in_sight[size][open ? 'options' : 'closed'] = await inSight('run') && await inSight('example');
    }
    seen.too_wide[size] = await tooWide();
  }

  seen.calls = [];
  await page.click('#example');
  await settled();
  seen.runs.push(await runs());
  seen.shown.push(await text('shown'));
  seen.coloured_by = await page.$eval('#voxels select', (select) => select.selectedOptions[0].textContent)
    .catch(() => null);
  await shot('example-desktop');
  const bytes = await page.$eval('#file', async ({files: [file]}) => [...new Uint8Array(await file.arrayBuffer())]);
  fs.mkdirSync(path.join(folder, 'mesh'));
  fs.writeFileSync(path.join(folder, 'mesh', 'knot.glb'), Buffer.from(bytes));

  await set('resolution', '48');
  await set('fill', 'FILL_PARITY');
  seen.stale = await text('stale');
  await page.click('#run');
  await settled();
  seen.runs.push(await runs());
  seen.stale_after = await text('stale');
  for (const name of ['glb', 'vox']) {
    await set('as', name);
    await page.click('#download');
    await page.waitForFunction(() => !document.getElementById('download').disabled, {timeout: 60_000});
    for (let i = 0; !fs.existsSync(path.join(folder, `knot.${name}`)) && i < 200; ++i) {
      await new Promise((done) => setTimeout(done, 50));
    }
    seen.runs.push(await runs());
  }
  seen.run_calls = seen.calls.filter((name) => name !== 'EstimateVoxelization');
  seen.mesh_bytes = await count('voxelpipe_received_bytes_total');

  await set('fill', 'FILL_FLOOD');
  await set('coverage', 'COVERAGE_NONE');
  seen.fills = await page.$$eval('#fill option:not(:disabled)', (options) => options.map(({value}) => value));
  seen.fill = await page.$eval('#fill', (select) => select.value);
  seen.shown.push(await text('shown'));
  await press('#add');
  await press('#add');
  seen.targets = await page.$$eval('.target', (rows) => rows.map((row) =>
    [...row.querySelectorAll('select')].map(({value}) => value.replace(/^[A-Z_]+_/, '')).join(' ')));
  seen.shown.push(await text('shown'));
  await press('.target button');
  await press('.target button');
  seen.targets_left = (await page.$$('.target')).length;
  seen.focus_after_removal = await page.evaluate(() => document.activeElement.id);
  await page.setViewport(SIZES.phone);
  await shot('example-phone');
  await set('size', '');
  await page.click('[value="size"]');
  await page.waitForSelector('[aria-invalid]', {timeout: 30_000});
  seen.wrong = await page.$eval('[aria-invalid]', (field) =>
    [field.id, document.getElementById(field.getAttribute('aria-errormessage')).textContent]);
  seen.error = await text('error');
  await shot('example-error');
  seen.too_wide.options = await tooWide();

  await page.click('[value="resolution"]');
  await page.evaluate(() => {
    const dropped = new DataTransfer();
    dropped.items.add(new File(['v 0 0 0\nv 1 0 0\nv 0 1 1\nf 1 2 3\n'], 'triangle.obj'));
    document.dispatchEvent(new DragEvent('drop', {dataTransfer: dropped, bubbles: true, cancelable: true}));
  });
  await page.waitForFunction(() => /^1 triangles/.test(document.getElementById('plan').textContent), {timeout: 30_000});
  await page.click('#run');
  await settled();
  seen.dropped = await text('summary');
  console.log(JSON.stringify(seen));
} finally {
  await browser.close();
}
