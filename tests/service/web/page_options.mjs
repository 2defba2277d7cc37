// usage: node page_options.mjs PAGE_FOLDER WORK_FOLDER
//
// Which options the page offers together, and what it says that the picture shows.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import path from 'node:path';
import {pathToFileURL} from 'node:url';

const [page, work] = process.argv.slice(2);
fs.mkdirSync(work, {recursive: true});
fs.writeFileSync(path.join(work, 'package.json'), '{"type": "module"}'); // as the browser takes the files
for (const name of ['rules.js', 'example.js']) fs.copyFileSync(path.join(page, name), path.join(work, name));
const {blendsOf, encodingsOf, fillsOf, shownText} = await import(pathToFileURL(path.join(work, 'rules.js')));

assert.deepEqual(fillsOf('COVERAGE_NONE', 'PART_SCOPE_WHOLE'), ['FILL_PARITY', 'FILL_NONZERO']);
assert.equal(fillsOf('COVERAGE_THIN', 'PART_SCOPE_WHOLE')[0], 'FILL_NONE');
assert.equal(fillsOf('COVERAGE_THIN', 'PART_SCOPE_WHOLE').length, 4);
assert.deepEqual(fillsOf('COVERAGE_THIN', 'PART_SCOPE_NODE'), ['FILL_NONE', 'FILL_PARITY', 'FILL_NONZERO']);

assert.deepEqual(blendsOf('VOXEL_FORMAT_BIT'),
  ['BLEND_OR', 'BLEND_AND', 'BLEND_REPLACE', 'BLEND_FIRST', 'BLEND_COUNT']);
assert.equal(blendsOf('VOXEL_FORMAT_U16').length, 9);
assert.equal(blendsOf('VOXEL_FORMAT_F16').length, 7);
for (const format of ['U8', 'F32']) assert.equal(blendsOf(`VOXEL_FORMAT_${format}`)[0], 'BLEND_REPLACE');

function encodings(shader, format, blend = 'REPLACE') {
  const names = encodingsOf({shader, format: `VOXEL_FORMAT_${format}`, blend: `BLEND_${blend}`});
  return names.map((name) => name.replace('ENCODING_', '')).join(' ');
}
assert.equal(encodings('base_color', 'U8'), 'SRGB LINEAR');
assert.equal(encodings('constant', 'U8', 'AVERAGE'), 'SRGB LINEAR');
assert.equal(encodings('base_color', 'U16'), 'LINEAR');
assert.equal(encodings('base_color', 'U8', 'COUNT'), 'LINEAR');
assert.equal(encodings('normal', 'U8'), 'SNORM LINEAR');
assert.equal(encodings('tangent', 'U16'), 'SNORM LINEAR');
assert.equal(encodings('normal', 'U32'), 'LINEAR');
assert.equal(encodings('normal', 'F32'), 'LINEAR');
assert.equal(encodings('position', 'U8'), 'LINEAR');

const target = (name, format) => ({shader: {name}, format: `VOXEL_FORMAT_${format}`});
const shows = (targets, coverage = 'COVERAGE_THIN') => shownText({coverage, targets});
assert.match(shows([]), /colours of the mesh/);
assert.match(shows([], 'COVERAGE_NONE'), /shape alone/);
assert.match(shows([target('occupancy', 'BIT')]), /shape alone/);
assert.equal(shows([target('occupancy', 'BIT'), target('normal', 'F32')]), 'The picture shows normal.');
assert.match(shows([target('normal', 'F32'), target('uv', 'F32')]), /shows normal, .*uv/);

globalThis.File ??= (await import('node:buffer')).File;
const {exampleMesh} = await import(pathToFileURL(path.join(work, 'example.js')));
const example = exampleMesh();
assert.ok(example.size < 100_000, `the example has ${example.size} bytes`);
