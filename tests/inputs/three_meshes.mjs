// usage: three_meshes.mjs read FILE... | write FILE.stl DIR
//
// read: for each mesh file what three.js makes of it, as FILE.three: u32 number of corners, u32 1 if there are colours,
// then three float32 a corner, and as many of its linear colour. The triangles in order.
// write: the mesh of an STL file by three.js's own writers: DIR/*.obj, *.ply, *.stl.
import fs from 'node:fs';
import path from 'node:path';
import { DOMParser } from 'linkedom';
import * as THREE from 'three';
import { OBJExporter } from 'three/examples/jsm/exporters/OBJExporter.js';
import { PLYExporter } from 'three/examples/jsm/exporters/PLYExporter.js';
import { STLExporter } from 'three/examples/jsm/exporters/STLExporter.js';
import { ThreeMFLoader } from 'three/examples/jsm/loaders/3MFLoader.js';
import { OBJLoader } from 'three/examples/jsm/loaders/OBJLoader.js';
import { PLYLoader } from 'three/examples/jsm/loaders/PLYLoader.js';
import { STLLoader } from 'three/examples/jsm/loaders/STLLoader.js';

globalThis.DOMParser = DOMParser;

function bytesOf(file) {
  const bytes = fs.readFileSync(file);
  return bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
}

function load(file) {
  switch (path.extname(file)) {
    case '.stl': return new THREE.Mesh(new STLLoader().parse(bytesOf(file)));
    case '.ply': return new THREE.Mesh(new PLYLoader().parse(bytesOf(file)));
    case '.obj': return new OBJLoader().parse(fs.readFileSync(file, 'utf8'));
    case '.3mf': return new ThreeMFLoader().parse(bytesOf(file));
    default: throw new Error(`no reader for ${file}`);
  }
}

function read(file) {
  const root = load(file);
  root.updateMatrixWorld(true);
  const corners = [], colors = [];
  let colored = false;
  root.traverse((object) => {
    if (!object.isMesh) return;
    const { position, color } = object.geometry.attributes;
    const index = object.geometry.index;
    const count = index === null ? position.count : index.count;
    colored ||= color !== undefined;
    const point = new THREE.Vector3();
    for (let i = 0; i < count; ++i) {
      const vertex = index === null ? i : index.getX(i);
      point.fromBufferAttribute(position, vertex).applyMatrix4(object.matrixWorld);
      corners.push(point.x, point.y, point.z);
      if (color === undefined) colors.push(1, 1, 1);
      else colors.push(color.getX(vertex), color.getY(vertex), color.getZ(vertex));
    }
  });
  const parts = [Uint32Array.of(corners.length / 3, colored ? 1 : 0), Float32Array.from(corners)];
  if (colored) parts.push(Float32Array.from(colors));
  fs.writeFileSync(`${file}.three`, Buffer.concat(parts.map((part) => Buffer.from(part.buffer))));
}

function write(file, folder) {
  const mesh = load(file);
  const name = path.join(folder, path.basename(file, '.stl'));
  fs.writeFileSync(`${name}.obj`, new OBJExporter().parse(mesh));
  fs.writeFileSync(`${name}-ascii.stl`, new STLExporter().parse(mesh));
  fs.writeFileSync(`${name}-ascii.ply`, new PLYExporter().parse(mesh, null, { binary: false }));
  for (const littleEndian of [true, false]) {
    const bytes = new PLYExporter().parse(mesh, null, { binary: true, littleEndian });
    fs.writeFileSync(`${name}-${littleEndian ? 'little' : 'big'}.ply`, Buffer.from(bytes));
  }
}

const [command, ...names] = process.argv.slice(2);
if (command === 'read') names.forEach(read);
else if (command === 'write') write(...names);
else process.exit(2);
