// usage: node page_errors.mjs PAGE_FOLDER WORK_FOLDER
//
// What the page's client makes of answers that are errors: the words of the server, whatever they look like, and
// whether a token is missing, and which fields of the request are at fault.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import path from 'node:path';
import {pathToFileURL} from 'node:url';

const [page, work] = process.argv.slice(2);
fs.mkdirSync(work, {recursive: true});
fs.writeFileSync(path.join(work, 'package.json'), '{"type": "module"}'); // as the browser takes the files
for (const name of ['client.js', 'messages.js']) fs.copyFileSync(path.join(page, name), path.join(work, name));
const {readFacts, Server} = await import(pathToFileURL(path.join(work, 'client.js')));

const methods = {Voxelize: {request: 'VoxelizeRequest', response: 'VoxelizeResponse'}};
const server = new Server({methods, messages: {VoxelizeRequest: {}}, enums: {}}, () => '');
const WAYS = {
  facts: () => readFacts(),
  call: () => server.one('Voxelize', {}),
  file: () => server.file('npy', {}),
};
const text = (status, body, headers = {}) =>
  new Response(body, {status, headers: {'content-type': 'text/plain; charset=utf-8', ...headers}});

// The error that a call makes of this answer.
async function errorOf(way, answer) {
  globalThis.fetch = async () => answer();
  try {
    await WAYS[way]();
  } catch (error) {
    return error;
  }
  return assert.fail(`${way}: no error`);
}

for (const way of Object.keys(WAYS)) {
  const unknown = await errorOf(way, () => text(401, 'the token is unknown\n', {'grpc-status': '16'}));
  assert.equal(unknown.message, 'the token is unknown', way);
  assert.equal(unknown.needsToken, true, way);
  const refused = await errorOf(way, () => text(403, 'the role monitor may not call it\n', {'grpc-status': '7'}));
  assert.equal(refused.message, 'the role monitor may not call it', way);
  assert.equal(refused.needsToken, false, way);
  for (const words of ['null', '12', '"said"', '{"message": 3}', 'format: \'doc\' is not one of npy']) {
    const error = await errorOf(way, () => text(400, `${words}\n`));
    assert.equal(error.message, words, `${way}: text that looks like JSON`);
  }
  const html = {'content-type': 'text/html'};
  const gateway = await errorOf(way, () => text(502, '<h1>Bad Gateway</h1>', html));
  assert.match(gateway.message, /^the server .*HTTP 502$/, way);
  assert.match((await errorOf(way, () => text(503, ''))).message, /HTTP 503$/, way);
}

// A gRPC-Web response of trailers alone.
function trailers(lines) {
  const bytes = new TextEncoder().encode(lines);
  const frame = new Uint8Array(5 + bytes.length);
  frame[0] = 128;
  new DataView(frame.buffer).setUint32(1, bytes.length);
  frame.set(bytes, 5);
  return new Response(frame, {headers: {'content-type': 'application/grpc-web+proto'}});
}
const ended = (lines) => errorOf('call', () => trailers(lines));
const needed = await ended('grpc-status: 16\r\ngrpc-message: a token is needed: authorization%3A Bearer TOKEN\r\n');
assert.equal(needed.message, 'a token is needed: authorization: Bearer TOKEN');
assert.equal(needed.needsToken, true);
assert.equal((await ended('grpc-status: 8\r\ngrpc-message: 100% is used\r\n')).message, '100% is used');
assert.deepEqual(needed.violations, []);

// google.rpc.Status with the details of an INVALID_ARGUMENT.
const {joined} = await import(pathToFileURL(path.join(work, 'messages.js')));
const text8 = (words) => new TextEncoder().encode(words);
const field = (number, bytes) => joined([Uint8Array.of(number * 8 + 2, bytes.length), bytes]);
const detail = (type, bytes) =>
  field(3, joined([field(1, text8(`type.googleapis.com/google.rpc.${type}`)), field(2, bytes)]));
const violation = field(1, joined([field(1, text8('grid.voxel_size')), field(2, text8('must be positive'))]));
const status = joined([detail('ErrorInfo', field(1, text8('INVALID_REQUEST'))), detail('BadRequest', violation)]);
const details = btoa(String.fromCharCode(...status)).replaceAll('=', '');
const violations = [{field: 'grid.voxel_size', description: 'must be positive'}];
const told = {'grpc-status': '3', 'grpc-status-details-bin': details};
assert.deepEqual((await errorOf('file', () => text(400, 'invalid', told))).violations, violations);
assert.deepEqual((await ended(`grpc-status: 3\r\ngrpc-status-details-bin: ${details}\r\n`)).violations, violations);
assert.deepEqual((await ended('grpc-status: 3\r\ngrpc-status-details-bin: CAFF\r\n')).violations, []);
