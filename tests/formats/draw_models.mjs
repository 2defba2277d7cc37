// usage: node draw_models.mjs NODE_MODULES BROWSER OUT.png FILE.glb|FILE.vox AZIMUTH ELEVATION
//
// Draws a model as three's loader of the format shows it, in a headless browser: y up, lights from the camera.
import fs from 'node:fs';
import http from 'node:http';
import {createRequire} from 'node:module';
import path from 'node:path';

const [modules, executablePath, out, file, azimuth, elevation] = process.argv.slice(2);
const puppeteer = createRequire(path.join(modules, 'x.js'))('puppeteer-core');
const PAGE = `<!DOCTYPE html><body style="margin:0"><script type="importmap">
{"imports": {"three": "/three/build/three.module.js", "three/": "/three/"}}</script><script type="module">
import * as THREE from 'three';
import {GLTFLoader} from 'three/examples/jsm/loaders/GLTFLoader.js';
import {VOXLoader} from 'three/examples/jsm/loaders/VOXLoader.js';
const vox = ${JSON.stringify(file.endsWith('.vox'))};
const renderer = new THREE.WebGLRenderer({antialias: true});
renderer.setSize(innerWidth, innerHeight);
document.body.append(renderer.domElement);
const scene = new THREE.Scene();
scene.background = new THREE.Color(0xffffff);
const loaded = await new (vox ? VOXLoader : GLTFLoader)().loadAsync('/model');
scene.add(loaded.scene);
const box = new THREE.Box3().setFromObject(loaded.scene);
const centre = box.getCenter(new THREE.Vector3()), radius = box.getSize(new THREE.Vector3()).length() / 2;
const [azimuth, elevation] = [${Number(azimuth)}, ${Number(elevation)}].map(THREE.MathUtils.degToRad);
const towards = new THREE.Vector3(Math.sin(azimuth) * Math.cos(elevation), Math.sin(elevation),
  Math.cos(azimuth) * Math.cos(elevation));
const camera = new THREE.PerspectiveCamera(30, innerWidth / innerHeight, radius / 100, radius * 10);
camera.position.copy(centre).addScaledVector(towards, radius * 3);
camera.lookAt(centre);
const light = new THREE.DirectionalLight(0xffffff, 2);
light.position.copy(camera.position);
light.target.position.copy(centre);
scene.add(light, light.target, new THREE.AmbientLight(0xffffff, 1.5));
renderer.render(scene, camera);
document.title = 'drawn';
</script>`;

const server = http.createServer((request, response) => {
  const asked = new URL(request.url, 'http://x').pathname;
  if (asked === '/') return response.setHeader('Content-Type', 'text/html').end(PAGE);
  const type = asked.endsWith('.js') ? 'text/javascript' : 'application/octet-stream';
  fs.createReadStream(asked === '/model' ? file : path.join(modules, asked))
    .on('error', () => response.writeHead(404).end()).pipe(response.setHeader('Content-Type', type));
}).listen(0, '127.0.0.1');
await new Promise((ready) => server.on('listening', ready));
const browser = await puppeteer.launch({
  executablePath, headless: 'shell', args: ['--no-sandbox', '--enable-unsafe-swiftshader'], protocolTimeout: 300_000,
});
try {
  const page = await browser.newPage();
  page.on('pageerror', (error) => console.error(error.message));
  page.on('console', (message) => { if (message.type() === 'error') console.error(message.text()); });
  await page.setViewport({width: 640, height: 480});
  await page.goto(`http://127.0.0.1:${server.address().port}/`);
  await page.waitForFunction(() => document.title === 'drawn', {timeout: 120_000});
  fs.writeFileSync(out, await page.screenshot());
} finally {
  await browser.close();
  server.close();
}
