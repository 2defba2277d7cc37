// usage: node page_mesh.mjs PAGE_FOLDER WORK_FOLDER
//
// When the page sends its mesh: once to a server that stores it, again where that has evicted it, and with every call
// to one that stores none.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import path from 'node:path';
import {pathToFileURL} from 'node:url';

const [page, work] = process.argv.slice(2);
fs.mkdirSync(work, {recursive: true});
fs.writeFileSync(path.join(work, 'package.json'), '{"type": "module"}'); // as the browser takes the files
for (const name of ['client.js', 'mesh.js', 'messages.js']) {
  fs.copyFileSync(path.join(page, name), path.join(work, name));
}
const {CallError} = await import(pathToFileURL(path.join(work, 'client.js')));
const {PageMesh} = await import(pathToFileURL(path.join(work, 'mesh.js')));

const INVALID_ARGUMENT = 3, NOT_FOUND = 5, PERMISSION_DENIED = 7, RESOURCE_EXHAUSTED = 8, UNAVAILABLE = 14;
const BYTES = Uint8Array.of(1, 2, 3);
const failure = (code) => new CallError(code, `status ${code}`);

// A mesh of a server whose CreateMesh answers with `answer`, and what that was asked.
function meshOf(answer, fileName = 'ball.glb') {
  const created = [];
  const server = {
    async one(method, request, signal) {
      assert.equal(method, 'CreateMesh');
      created.push(request.mesh);
      return {name: await answer(request.mesh, signal)};
    },
  };
  return {mesh: new PageMesh(server, fileName, BYTES), created};
}
const stored = (name) => ({stored: {name}});
const sent = (format) => ({bytes: {data: BYTES, format}});
const same = async (source) => source;

{
  const {mesh, created} = meshOf(async () => 'meshes/a');
  assert.deepEqual(await Promise.all([mesh.use(same), mesh.use(same)]), [stored('meshes/a'), stored('meshes/a')]);
  assert.deepEqual(await mesh.use(same), stored('meshes/a'));
  assert.deepEqual(created, [{data: BYTES, format: undefined}], 'sent once');
  assert.equal(mesh.name, 'ball');
  mesh.forget();
  await mesh.use(same);
  assert.equal(created.length, 2);
}
{
  const {mesh, created} = meshOf(async () => `meshes/${created.length}`);
  const evicted = async (source) => {
    if (source.stored.name === 'meshes/1') throw failure(NOT_FOUND);
    return source;
  };
  assert.deepEqual(await mesh.use(evicted), stored('meshes/2'), 'stored again');
}
{
  const {mesh, created} = meshOf(async () => 'meshes/a');
  const never = async (source) => {
    if (source.stored) throw failure(NOT_FOUND);
    return source;
  };
  assert.deepEqual(await mesh.use(never), sent(undefined), 'a store that keeps nothing');
  assert.equal(created.length, 2);
}
for (const code of [PERMISSION_DENIED, RESOURCE_EXHAUSTED]) {
  const {mesh, created} = meshOf(async () => { throw failure(code); });
  assert.deepEqual(await mesh.use(same), sent(undefined));
  assert.deepEqual(await mesh.use(same), sent(undefined));
  assert.equal(created.length, 1, 'refused once');
}
{
  const {mesh, created} = meshOf(async () => { throw failure(UNAVAILABLE); });
  await assert.rejects(mesh.use(same), /status 14/);
  await assert.rejects(mesh.use(same), /status 14/);
  assert.equal(created.length, 2, 'tried again');
}
{ // The content shows no format.
  const needed = async ({format}) => {
    if (!format) throw failure(INVALID_ARGUMENT);
    return 'meshes/a-obj';
  };
  const {mesh, created} = meshOf(needed, 'ball.v2.OBJ');
  assert.deepEqual(await mesh.use(same), stored('meshes/a-obj'));
  assert.deepEqual(created.map(({format}) => format), [undefined, 'MESH_FORMAT_OBJ']);
  assert.equal(mesh.name, 'ball.v2');
  const unnamed = meshOf(needed, 'ball');
  await assert.rejects(unnamed.mesh.use(same), /status 3/);
  await assert.rejects(unnamed.mesh.use(same), /status 3/);
  assert.equal(unnamed.created.length, 1, 'no mesh is not sent again');
  const sends = meshOf(async () => { throw failure(RESOURCE_EXHAUSTED); }, 'ball.obj').mesh;
  assert.deepEqual(await sends.use(async (source) => (await needed(source.bytes)) && source), sent('MESH_FORMAT_OBJ'));
}
{ // A call that ends while the mesh is sent leaves the sending to the next one; that of another mesh ends.
  let answer;
  const {mesh, created} = meshOf((_, signal) => new Promise((resolve, reject) => {
    answer = resolve;
    signal.addEventListener('abort', () => reject(signal.reason));
  }));
  const ended = new AbortController();
  const call = mesh.use(same, ended.signal);
  ended.abort();
  await assert.rejects(call, {name: 'AbortError'});
  const next = mesh.use(same);
  answer('meshes/a');
  assert.deepEqual(await next, stored('meshes/a'));
  assert.equal(created.length, 1);
  mesh.forget();
  const discarded = mesh.use(same);
  mesh.discard();
  await assert.rejects(discarded, {name: 'AbortError'});
}
