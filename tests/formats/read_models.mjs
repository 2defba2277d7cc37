// usage: node read_models.mjs NODE_MODULES FILE.glb|FILE.vox
//
// Prints as one JSON object what readers of others make of a model: gltf-validator and three's GLTFLoader, or vox-reader
// and three's VOXLoader.
import fs from 'node:fs';
import {createRequire} from 'node:module';
import path from 'node:path';
import {pathToFileURL} from 'node:url';

const [modules, file] = process.argv.slice(2);
const require = createRequire(path.join(modules, 'x.js'));
const three = (name) => import(pathToFileURL(path.join(modules, 'three', name)));
const THREE = await three('build/three.module.js');
const bytes = fs.readFileSync(file);
const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);

async function readGlb() {
  const report = await require('gltf-validator').validateBytes(new Uint8Array(buffer));
  const {GLTFLoader} = await three('examples/jsm/loaders/GLTFLoader.js');
  const gltf = await new GLTFLoader().parseAsync(buffer, '');
  gltf.scene.updateMatrixWorld(true);
  const meshes = [];
  gltf.scene.traverse((object) => {
    if (!object.isMesh) return;
    const positions = object.geometry.getAttribute('position');
    const point = new THREE.Vector3();
    const world = [];
    for (let i = 0; i < positions.count; ++i) {
      world.push(point.fromBufferAttribute(positions, i).applyMatrix4(object.matrixWorld).toArray());
    }
    const colour = object.geometry.getAttribute('color');
    const colours = [];
    for (let i = 0; colour && i < colour.count; ++i) colours.push([colour.getX(i), colour.getY(i), colour.getZ(i)]);
    meshes.push({world, colours, indices: Array.from(object.geometry.index.array)});
  });
  return {issues: report.issues, meshes};
}

async function readVox() {
  const read = require('vox-reader')([...bytes]);
  const {VOXLoader} = await three('examples/jsm/loaders/VOXLoader.js');
  const {chunks, scene} = new VOXLoader().parse(buffer);
  const boxes = [];
  if (scene) {
    scene.updateMatrixWorld(true);
    scene.traverse((object) => {
      if (!object.isMesh) return;
      const box = new THREE.Box3().setFromObject(object);
      if (!box.isEmpty()) boxes.push([box.min.toArray(), box.max.toArray()]);
    });
  }
  const models = chunks.map(({size, data, palette}) => ({size, data: Array.from(data), palette: Array.from(palette)}));
  return {read, models, boxes};
}

console.log(JSON.stringify(await (file.endsWith('.glb') ? readGlb() : readVox())));
