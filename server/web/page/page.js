// The server's page: a mesh, a request, progress, the voxels, and files of them.
import {readFacts, Server} from './client.js';

const $ = (id) => document.getElementById(id);
const COLOURS = new Set(['base_color', 'emissive', 'color']);
const FORMATS = new Map([['drc', 'MESH_FORMAT_DRACO']]); // by extension
for (const name of ['glb', 'gltf', 'stl', 'ply', 'off', 'obj', '3mf']) {
  FORMATS.set(name, `MESH_FORMAT_${name.toUpperCase()}`);
}
const FRAGMENT = 2; // SHADER_STAGE_FRAGMENT
const FACTS = await readFacts().catch((error) => {
  say(error);
  throw error;
});
const server = new Server(FACTS, () => $('token').value.trim());
const ESTIMATE_LIMIT_BYTES = 4 << 20; // larger meshes are sent for the result alone

let mesh = null; // Uint8Array
let meshName = '';
let named = undefined; // the format that the file's name tells
let told = undefined; // the same, once the server has asked for it
let shaders = new Map();
let limits = null;
let running = null; // AbortController
let shown = null; // the request of the result
let viewer = null;

// Nothing of an error that the person caused by cancelling.
function say(error) {
  $('error').textContent = error.name === 'AbortError' ? '' : error.message;
}

const bytesText = (bytes) => {
  const units = ['B', 'KiB', 'MiB', 'GiB', 'TiB'];
  let [value, unit] = [Number(bytes), 0];
  while (value >= 1024 && unit + 1 < units.length) [value, unit] = [value / 1024, unit + 1];
  return `${unit === 0 ? value : value.toPrecision(3)} ${units[unit]}`;
};
const dimsText = ({x, y, z}) => `${x} x ${y} x ${z}`;

// A VoxelizeConfig of what is chosen.
function configOf() {
  const targets = [{format: 'VOXEL_FORMAT_BIT', blend: 'BLEND_OR'}];
  const name = $('shader').value;
  if (name && name !== 'occupancy') {
    const format = $('format').value;
    const srgb = format === 'VOXEL_FORMAT_U8' && COLOURS.has(name);
    targets.push({format, blend: $('blend').value, shader: {name}, encoding: srgb ? 'ENCODING_SRGB' : undefined});
  }
  const bySize = $('form').elements.by.value === 'size';
  const size = Number($('size').value);
  const resolution = Math.max(0, Math.round(Number($('resolution').value)));
  const grid = bySize ? {voxel_size: {x: size, y: size, z: size}} : {resolution};
  return {grid, targets, coverage: $('coverage').value, fill: $('fill').value, mesh_format: told};
}

// Calls again, with the format that the file's name tells, where the content shows none. In: a call that takes its
// config from configOf.
async function withFormat(call) {
  try {
    return await call();
  } catch (error) {
    if (!error.invalid || told || !named) throw error;
    told = named;
    try {
      return await call();
    } catch (second) {
      if (second.invalid) told = undefined;
      throw second.invalid ? error : second;
    }
  }
}

async function connect() {
  try {
    const [info, list] = await Promise.all([server.one('GetServerInfo', {}), server.one('ListShaders', {})]);
    limits = info.limits;
    $('server').textContent = `version ${info.version}, ${info.devices.map((d) => d.model || d.name).join(', ')}`;
    const chosen = $('shader').value || 'normal';
    shaders = new Map(list.shaders.filter((s) => s.stage === FRAGMENT).map((s) => [s.name, s]));
    $('shader').replaceChildren(...[...shaders.keys()].map((name) => new Option(name, name)));
    if (shaders.has(chosen)) $('shader').value = chosen;
    describeShader();
    $('error').textContent = '';
  } catch (error) {
    $('server').textContent = 'not connected';
    say(error);
    if (error.needsToken) $('token').focus();
  }
}

function describeShader() {
  const shader = shaders.get($('shader').value);
  $('shader-about').textContent =
    shader ? `${shader.description} (${shader.output_type} x ${shader.output_components})` : '';
}

async function take(file) {
  if (!file) return;
  const limit = limits ? limits.max_message_bytes : 64 << 20;
  if (file.size >= limit) {
    $('error').textContent = `${file.name} has ${bytesText(file.size)}; the page sends up to ${bytesText(limit)}. ` +
      'For larger meshes: voxelpipe voxelize --server.';
    return;
  }
  mesh = new Uint8Array(await file.arrayBuffer());
  meshName = file.name.replace(/\.[^.]*$/, '');
  named = FORMATS.get(file.name.slice(meshName.length + 1).toLowerCase());
  told = undefined;
  $('error').textContent = '';
  $('about').textContent = `${file.name}, ${bytesText(file.size)}`;
  estimate();
}

let estimating = null;
async function estimate() {
  estimating?.abort();
  $('plan').textContent = '';
  if (!mesh || mesh.length > ESTIMATE_LIMIT_BYTES || running) return;
  const own = (estimating = new AbortController());
  try {
    const {plan, mesh: report} = await withFormat(
      () => server.one('EstimateVoxelization', {config: configOf(), mesh_bytes: mesh}, own.signal));
    $('error').textContent = '';
    $('plan').textContent = `${report.triangles} triangles; ${dimsText(plan.grid.dims)} voxels, ` +
      `${bytesText(plan.result_bytes)} on ${plan.backend}`;
  } catch (error) {
    if (own === estimating) say(error);
  }
}

function showSummary(summary) {
  const {stats} = summary;
  const where = `${stats.worker || stats.backend}${summary.cached ? ', from the cache' : ''}`;
  $('summary').textContent = `${stats.occupied} occupied voxels of ${stats.triangles} triangles in ` +
    `${stats.voxelize_ms.toFixed(1)} ms on ${where}.`;
  $('warnings').replaceChildren(...summary.warnings.map(({place, text}) => {
    const item = document.createElement('li');
    item.textContent = place ? `${place}: ${text}` : text;
    return item;
  }));
  if (summary.warnings_left_out > 0) $('warnings').append(`and ${summary.warnings_left_out} more`);
}

function see({accepted, progress, summary, whole}) {
  if (accepted) $('stage').textContent = `accepted: ${dimsText(accepted.grid.dims)} voxels`;
  if (progress) {
    $('progress').value = progress.fraction ?? 0;
    $('stage').textContent = progress.stage;
  }
  if (summary ?? whole) showSummary(summary ?? whole.summary);
}

async function showVoxels(request, signal) {
  if (!FACTS.formats.some(({name}) => name === 'html')) {
    $('voxels').textContent = 'This server was built without the viewer. The files can be downloaded.';
    return;
  }
  $('stage').textContent = 'viewer';
  const {blob} = await server.file('html', request, signal);
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

async function run(event) {
  event.preventDefault();
  if (!mesh || running) return;
  estimating?.abort();
  let request = null;
  running = new AbortController();
  $('run').disabled = true;
  $('cancel').disabled = false;
  $('progress').hidden = false;
  $('progress').value = 0;
  $('error').textContent = '';
  $('form').dataset.state = 'running';
  let state = 'failed';
  try {
    await withFormat(async () => {
      request = {config: configOf(), mesh};
      for await (const answer of server.call('VoxelizeMesh', request, running.signal)) see(answer);
    });
    shown = request;
    $('result').hidden = false;
    await showVoxels(request, running.signal);
    $('stage').textContent = 'done';
    state = 'done';
  } catch (error) {
    $('stage').textContent = running.signal.aborted ? 'cancelled' : '';
    say(error);
    if (running.signal.aborted) state = 'cancelled';
  }
  running = null;
  $('run').disabled = false;
  $('cancel').disabled = true;
  $('progress').hidden = true;
  $('form').dataset.state = state;
}

async function download() {
  const name = $('as').value;
  $('download').disabled = true;
  $('error').textContent = '';
  try {
    const file = await server.file(name, shown);
    const link = document.createElement('a');
    link.href = URL.createObjectURL(file.blob);
    link.download = file.name.replace(/^result/, meshName);
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
  } catch (error) {
    say(error);
  }
  $('download').disabled = false;
}

$('form').addEventListener('submit', run);
$('form').addEventListener('change', (event) => {
  if (event.target === $('file')) take(event.target.files[0]);
  else if (event.target === $('token')) connect();
  else estimate();
});
$('shader').addEventListener('change', describeShader);
for (const by of ['size', 'resolution']) {
  $(by).addEventListener('input', () => { $('form').elements.by.value = by; });
}
$('cancel').addEventListener('click', () => running?.abort());
$('download').addEventListener('click', download);
for (const type of ['dragover', 'dragleave', 'drop']) {
  document.addEventListener(type, (event) => {
    event.preventDefault();
    $('drop').classList.toggle('over', type === 'dragover');
    if (type === 'drop') take(event.dataTransfer.files[0]);
  });
}
$('as').replaceChildren(...FACTS.formats.map(({name, title}) => new Option(`.${name}: ${title}`, name)));
await connect();
