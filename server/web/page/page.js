// The server's page: a mesh, a request, progress, the voxels, and files of them.
import {readFacts, Server} from './client.js';
import {exampleMesh} from './example.js';
import {PageMesh} from './mesh.js';
import {Options, wordOf} from './options.js';

const $ = (id) => document.getElementById(id);
const options = new Options($('form'));
const FACTS = await readFacts().catch((error) => {
  say(error);
  throw error;
});
const server = new Server(FACTS, () => $('token').value.trim());
const SHOWS_VOXELS = FACTS.formats.some(({name}) => name === 'html');
const ESTIMATE_LIMIT_BYTES = 4 << 20; // larger meshes that are not stored are sent for the result alone

let mesh = null; // PageMesh
let limits = null;
let running = null; // AbortController
let shown = null; // mesh and spec of the result
let viewer = null;

// Nothing of an error that the person caused by cancelling. Out: the field of the form that the error names, or null.
function say(error) {
  $('error').textContent = error.name === 'AbortError' ? '' : error.message;
  return options.mark(error.violations ?? []);
}

function sayNothing() {
  $('error').textContent = '';
  options.mark([]);
}

const bytesText = (bytes) => {
  const units = ['B', 'KiB', 'MiB', 'GiB', 'TiB'];
  let [value, unit] = [Number(bytes), 0];
  while (value >= 1024 && unit + 1 < units.length) [value, unit] = [value / 1024, unit + 1];
  return `${unit === 0 ? value : value.toPrecision(3)} ${units[unit]}`;
};
const dimsText = ({x, y, z}) => `${x} x ${y} x ${z}`;
const msOf = ({seconds, nanos}) => seconds * 1e3 + nanos * 1e-6;

async function connect() {
  mesh?.forget(); // another client may store what the last one could not
  try {
    const [info, list] = await Promise.all([server.one('GetServerInfo', {}), server.one('ListShaders', {})]);
    limits = info.limits;
    $('server').textContent = `version ${info.version}, ${info.devices.map((d) => d.model || d.name).join(', ')}`;
    options.setShaders(list.shaders);
    $('example').disabled = false;
    sayNothing();
  } catch (error) {
    $('server').textContent = 'not connected';
    say(error);
    if (!error.needsToken) return;
    $('token-label').hidden = false;
    $('token').focus();
  }
}

async function take(file) {
  if (!file) return;
  const limit = limits ? limits.max_message_bytes : 64 << 20;
  if (file.size >= limit) {
    $('error').textContent = `${file.name} has ${bytesText(file.size)}; the page sends up to ${bytesText(limit)}. ` +
      'For larger meshes: voxelpipe voxelize --server.';
    return;
  }
  const bytes = new Uint8Array(await file.arrayBuffer());
  if (!running) mesh?.discard();
  mesh = new PageMesh(server, file.name, bytes);
  sayNothing();
  $('about').textContent = `${file.name}, ${bytesText(file.size)}`;
  estimate();
}

// A file that was not chosen with the field: as if it were.
function put(file) {
  if (!file) return;
  const files = new DataTransfer();
  files.items.add(file);
  $('file').files = files.files;
  return take(file);
}

async function tryExample() {
  if (running) return;
  await put(exampleMesh());
  $('form').requestSubmit();
}

let estimating = null;
async function estimate() {
  estimating?.abort();
  $('plan').textContent = '';
  if (!mesh || running) return;
  const own = (estimating = new AbortController());
  const [file, spec] = [mesh, options.spec()];
  try {
    const answer = await file.use(async (source) => {
      if (source.bytes && file.size > ESTIMATE_LIMIT_BYTES) return null;
      return server.one('EstimateVoxelization', {mesh: source, spec}, own.signal);
    }, own.signal);
    sayNothing();
    if (!answer) return;
    const {plan, report} = answer;
    const bytes = spec.targets.length > 0 ? `${bytesText(plan.result_bytes)} ` : ''; // else by the format of the file
    $('plan').textContent = `${report.triangles} triangles; ${dimsText(plan.grid.dims)} voxels, ` +
      `${bytes}on ${wordOf(plan.backend)}`;
  } catch (error) {
    if (own === estimating) say(error);
  }
}

function showSummary(summary) {
  const {stats} = summary;
  const where = `${stats.worker || wordOf(stats.backend)}${summary.cached ? ', from the cache' : ''}`;
  $('summary').textContent = `${stats.occupied} occupied voxels of ${stats.triangles} triangles in ` +
    `${msOf(stats.voxelize_time).toFixed(1)} ms on ${where}.`;
  $('warnings').replaceChildren(...summary.warnings.map(({place, text}) => {
    const item = document.createElement('li');
    item.textContent = place ? `${place}: ${text}` : text;
    return item;
  }));
  if (summary.warnings_left_out > 0) $('warnings').append(`and ${summary.warnings_left_out} more`);
}

// Out: the summary of the result, and a page with its voxels, if this server makes one.
async function voxelize(request, signal) {
  if (SHOWS_VOXELS) return server.file('html', request, signal);
  let summary;
  for await (const answer of server.call('Voxelize', request, signal)) {
    if (answer.progress) {
      $('progress').value = answer.progress.fraction;
      $('stage').textContent = answer.progress.stage;
    }
    summary = answer.summary ?? summary;
  }
  return {summary};
}

async function showVoxels(blob) {
  if (!blob) {
    $('voxels').textContent = 'This server was built without the viewer. The files can be downloaded.';
    return;
  }
  const {mountViewer, payloadOf} = await import('./viewer.js');
  const payload = await payloadOf(await blob.text());
  viewer?.dispose();
  viewer = null;
  try {
    viewer = mountViewer($('voxels'), payload);
  } catch (error) {
    $('voxels').textContent = `The voxels cannot be shown: ${error.message}.`;
  }
}

// After a run without a result: what is too large for a picture may fit into a file.
function offerFiles(asked) {
  shown = asked;
  noteStale();
  viewer?.dispose();
  viewer = null;
  $('voxels').textContent = 'There is no picture of these voxels, but there may be files of them.';
  $('summary').textContent = '';
  $('warnings').replaceChildren();
  $('result').hidden = false;
}

async function run(event) {
  event.preventDefault();
  if (!mesh || running) return;
  estimating?.abort();
  const asked = {mesh, spec: options.spec()};
  running = new AbortController();
  const {signal} = running;
  $('cancel').disabled = false;
  if (document.activeElement === $('run')) $('cancel').focus();
  $('run').disabled = true;
  $('progress').hidden = false;
  $('progress').removeAttribute('value');
  sayNothing();
  $('form').dataset.state = 'running';
  $('stage').textContent = 'sending the mesh';
  let state = 'failed';
  try {
    const {summary, blob} = await asked.mesh.use((source) => {
      $('stage').textContent = 'voxelizing';
      return voxelize({mesh: source, spec: asked.spec}, signal);
    }, signal);
    shown = asked;
    showSummary(summary);
    $('result').hidden = false;
    noteStale();
    await showVoxels(blob);
    $('stage').textContent = 'done';
    state = 'done';
  } catch (error) {
    $('stage').textContent = signal.aborted ? 'cancelled' : '';
    say(error)?.focus();
    if (signal.aborted) state = 'cancelled';
    if (error.exhausted) offerFiles(asked);
  }
  running = null;
  $('run').disabled = false;
  if (document.activeElement === $('cancel')) $('run').focus({preventScroll: true});
  $('cancel').disabled = true;
  $('progress').hidden = true;
  $('form').dataset.state = state;
  if (state === 'done' && $('result').getBoundingClientRect().top > window.innerHeight / 2) {
    $('result').scrollIntoView(); // a narrow window has it below the form
  }
}

// Whether the result is that of the options.
function noteStale() {
  if (!shown) return;
  const same = shown.mesh === mesh && JSON.stringify(shown.spec) === JSON.stringify(options.spec());
  $('stale').textContent = same ? '' : 'Picture and downloads are those of the last run, with its mesh and options.';
}

async function download() {
  const format = $('as').value;
  const {mesh: own, spec} = shown;
  $('download').disabled = true;
  sayNothing();
  try {
    const file = await own.use((source) => server.file(format, {mesh: source, spec}));
    const link = document.createElement('a');
    link.href = URL.createObjectURL(file.blob);
    link.download = file.name.replace(/^result/, own.name);
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
  } catch (error) {
    say(error);
  }
  $('download').disabled = false;
}

$('form').addEventListener('submit', run);
$('form').addEventListener('change', (event) => {
  if (event.target === $('token')) connect();
  else if (event.target !== $('file')) estimate();
  else take(event.target.files[0]).then(noteStale);
  noteStale();
});
$('example').addEventListener('click', tryExample);
$('cancel').addEventListener('click', () => running?.abort());
$('download').addEventListener('click', download);
for (const type of ['dragover', 'dragleave', 'drop']) {
  document.addEventListener(type, (event) => {
    event.preventDefault();
    $('drop').classList.toggle('over', type === 'dragover');
    if (type === 'drop') put(event.dataTransfer.files[0])?.then(noteStale);
  });
}
$('options').open = window.matchMedia('(min-width: 50rem)').matches;
$('as').replaceChildren(...FACTS.formats.map(({name, title}) => new Option(`.${name}: ${title}`, name)));
await connect();
