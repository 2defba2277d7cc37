// Faces of voxels with WebGL 2: a draw call for each direction that faces the camera. Vertices read rectangles of faces
// from textures; instances of four vertices each would be slow where WebGL runs in software.
import {
  BufferAttribute, BufferGeometry, DataTexture, GLSL3, Mesh, OrthographicCamera, RawShaderMaterial, RGBAFormat,
  RGBAIntegerFormat, Scene, UnsignedByteType, UnsignedIntType, Vector3, WebGLRenderer,
} from 'three';

import {voxelOnRay} from './pick.js';
import {cutQuads, exposedQuads, runAxis, WORDS} from './quads.js';

const TEXTURE_WIDTH = 2048;
// Of the inside, where a slice cuts it: hatched as in sections of drawings, so that no surface looks like it.
export const [CUT_COLOUR, HATCH_COLOUR] = [0xd8d2c4, 0x8d8778];
const HATCHES = 40; // along the box's diagonal
const GROWN_PIXELS = 0.1; // of rectangles, on each side: where their corners meet edges, rounding would leave gaps

// In the order of the bits of a cell: -x, +x, -y, +y, -z, +z. `shade`: light from above and the front.
const SIDES = [
  {corners: [[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0]], shade: 0.72},
  {corners: [[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]], shade: 0.84},
  {corners: [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], shade: 0.55},
  {corners: [[0, 1, 0], [0, 1, 1], [1, 1, 1], [1, 1, 0]], shade: 1.0},
  {corners: [[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]], shade: 0.65},
  {corners: [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], shade: 0.93},
];

const VERTEX = `
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;
uniform usampler2D quads;
uniform mat4 projectionMatrix, modelViewMatrix;
uniform vec3 voxelSize, low, high, grown, corners[4];
uniform float hatches;     // a unit of the scene
uniform int run;           // the axis along which rectangles are long
uniform sampler2D colours; // by voxel
uniform vec3 cut;          // the colour of voxels that are not listed
uniform float shade;
flat out vec4 shown;       // 0 in the last place: not listed
out float hatch;           // along the diagonal of the box
ivec2 place(int n) {
  return ivec2(n % ${TEXTURE_WIDTH}, n / ${TEXTURE_WIDTH});
}
void main() {
  uvec4 quad = texelFetch(quads, place(gl_VertexID / 4), 0);
  vec3 begin = vec3(quad.x & 0xffffu, quad.x >> 16, quad.y & 0xffffu), size = vec3(1.0);
  size[run] = float(quad.y >> 16);
  vec3 from = max(begin, low), to = min(begin + size, high);
  vec3 corner = mix(from - grown, to + grown, corners[gl_VertexID % 4]);
  gl_Position = any(greaterThanEqual(from, to)) ? vec4(0.0, 0.0, 2.0, 1.0)
                                                : projectionMatrix * modelViewMatrix * vec4(corner * voxelSize, 1.0);
  shown = quad.z == 0u ? vec4(shade * cut, 0.0)
                       : vec4(shade * texelFetch(colours, place(int(quad.z) - 1), 0).rgb, 1.0);
  hatch = dot(corner * voxelSize, vec3(hatches));
}`;

const FRAGMENT = `
precision highp float;
uniform vec3 line;  // of the hatches
uniform float shade;
flat in vec4 shown;
in float hatch;
out vec4 result;
void main() {
  result = vec4(shown.a == 0.0 && fract(hatch) < 0.2 ? shade * line : shown.rgb, 1.0);
}`;

// In: numbers of `items` entries of four. Out: a texture of them, row after row.
function tableOf(array, type, format, internalFormat) {
  const height = Math.max(1, Math.ceil(array.length / 4 / TEXTURE_WIDTH));
  const padded = new array.constructor(4 * TEXTURE_WIDTH * height);
  padded.set(array);
  const texture = new DataTexture(padded, TEXTURE_WIDTH, height, format, type);
  if (internalFormat) texture.internalFormat = internalFormat;
  texture.needsUpdate = true;
  return texture;
}

const rgbOf = (code) => new Vector3(code >> 16, (code >> 8) & 255, code & 255).divideScalar(255);

// Two triangles a rectangle.
function indexOf(quads) {
  const index = new Uint32Array(6 * quads);
  for (let n = 0; n < quads; ++n) {
    const v = 4 * n;
    index[6 * n] = index[6 * n + 3] = v;
    index[6 * n + 1] = v + 1;
    index[6 * n + 2] = index[6 * n + 4] = v + 2;
    index[6 * n + 5] = v + 3;
  }
  return new BufferAttribute(index, 1);
}

export class VoxelScene {
  // In: a canvas, and a read payload. Throws an Error if the browser has no WebGL 2.
  constructor(canvas, data) {
    const context = canvas.getContext('webgl2', {antialias: false});
    if (!context) throw new Error('this browser has no WebGL 2');
    this.renderer = new WebGLRenderer({canvas, context});
    this.renderer.setClearColor(0, 0); // the background is the page's
    this.data = data;
    const largest = Math.max(...data.voxel_size);
    this.voxelSize = new Vector3(...data.voxel_size.map((size) => size / largest));
    this.box = new Vector3(...data.dims).multiply(this.voxelSize);
    this.low = new Vector3(0, 0, 0);
    this.high = new Vector3(...data.dims);
    this.grown = new Vector3();
    this.camera = new OrthographicCamera();
    this.scene = new Scene();
    this.colours = tableOf(new Uint8Array(4 * data.voxels), UnsignedByteType, RGBAFormat);
    this.index = indexOf(0);
    this.sides = SIDES.map((_, side) => this.#show(this.#addMesh(side), exposedQuads(data, side)));
    this.faces = this.sides.reduce((sum, mesh) => sum + mesh.geometry.drawRange.count / 6, 0);
    this.cuts = SIDES.map((_, side) => this.#addMesh(side));
  }

  #addMesh(side) {
    const material = new RawShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: {
        quads: {value: null},
        colours: {value: this.colours},
        cut: {value: rgbOf(CUT_COLOUR)}, line: {value: rgbOf(HATCH_COLOUR)},
        hatches: {value: HATCHES / this.box.length()},
        corners: {value: SIDES[side].corners.map((corner) => new Vector3(...corner))},
        voxelSize: {value: this.voxelSize}, low: {value: this.low}, high: {value: this.high},
        grown: {value: this.grown},
        run: {value: runAxis(side)}, shade: {value: SIDES[side].shade},
      },
    });
    const mesh = new Mesh(new BufferGeometry(), material);
    mesh.frustumCulled = false;
    this.scene.add(mesh);
    return mesh;
  }

  // Gives a mesh its rectangles.
  #show(mesh, words) {
    const quads = words.length / WORDS;
    if (this.index.count < 6 * quads) this.index = indexOf(quads);
    mesh.geometry.setIndex(this.index);
    mesh.geometry.setDrawRange(0, 6 * quads);
    mesh.material.uniforms.quads.value?.dispose();
    mesh.material.uniforms.quads.value = tableOf(words, UnsignedIntType, RGBAIntegerFormat, 'RGBA32UI');
    return mesh;
  }

  // In: RGBA bytes by voxel.
  setColours(rgba) {
    this.colours.image.data.set(rgba);
    this.colours.needsUpdate = true;
  }

  // Hides voxels whose index on this axis is below `from` or at least `to`, and closes the solids that this cuts.
  setSlice(axis, from, to) {
    if (from !== this.low.getComponent(axis)) this.#cut(2 * axis, from);
    if (to !== this.high.getComponent(axis)) this.#cut(2 * axis + 1, to - 1);
    this.low.setComponent(axis, from);
    this.high.setComponent(axis, to);
  }

  #cut(side, layer) {
    const {words, inside} = cutQuads(this.data, side, layer);
    this.#show(this.cuts[side], words).userData.inside = inside;
  }

  // True if a slice cuts voxels that are not listed.
  get cutsInside() {
    return this.cuts.some((mesh) => mesh.userData.inside);
  }

  // Looks from here, in degrees as --view has them, at the middle of the grid, which fills the window.
  setView(azimuth, elevation) {
    const [a, e] = [azimuth, elevation].map((degrees) => degrees * Math.PI / 180);
    const middle = this.box.clone().multiplyScalar(0.5);
    const distance = this.box.length() + 1;
    const eye = new Vector3(Math.cos(e) * Math.sin(a), Math.sin(e), Math.cos(e) * Math.cos(a));
    // Straight from above or below, "up" is -z or +z.
    this.camera.up.set(0, 1, 0);
    if (Math.abs(elevation) > 89.99) eye.set(1e-4 * Math.sin(a), Math.sign(elevation), 1e-4 * Math.cos(a));
    this.camera.position.copy(middle).addScaledVector(eye, distance);
    this.camera.near = 0;
    this.camera.far = 2 * distance + this.box.length();
    this.camera.zoom = 1;
    this.camera.lookAt(middle);
    this.camera.updateMatrixWorld();
    return middle;
  }

  resize(width, height) {
    const half = 0.55 * this.box.length();
    const [x, y] = width > height ? [half * width / height, half] : [half, half * height / width];
    Object.assign(this.camera, {left: -x, right: x, top: y, bottom: -y});
    this.camera.updateProjectionMatrix();
    this.size = [width, height];
  }

  // In: pixels of the picture for one of CSS, each way. Sides that face away are not drawn: solids hide them.
  render(ratio) {
    const [width, height] = this.size.map((size) => Math.ceil(size * ratio));
    const canvas = this.renderer.domElement;
    if (canvas.width !== width || canvas.height !== height) this.renderer.setSize(width, height, false);
    const pixel = (this.camera.right - this.camera.left) / this.camera.zoom / width;
    this.grown.setScalar(GROWN_PIXELS * pixel).divide(this.voxelSize);
    const view = this.camera.getWorldDirection(new Vector3()).toArray();
    for (const meshes of [this.sides, this.cuts]) {
      meshes.forEach((mesh, side) => {
        mesh.visible = mesh.geometry.drawRange.count > 0 && (side % 2 ? view[side >> 1] < 0 : view[side >> 1] > 0);
      });
    }
    this.renderer.render(this.scene, this.camera);
  }

  // The voxel at a point of the canvas, in CSS pixels: as voxelOnRay.
  pick(x, y) {
    const [width, height] = this.size;
    const from = new Vector3(2 * x / width - 1, 1 - 2 * y / height, -1).unproject(this.camera);
    const along = this.camera.getWorldDirection(new Vector3());
    const [begin, step] = [from, along].map((point) => point.divide(this.voxelSize).toArray());
    return voxelOnRay(this.data, begin, step, this.low.toArray(), this.high.toArray());
  }

  dispose() {
    for (const {geometry, material} of [...this.sides, ...this.cuts]) {
      geometry.dispose();
      material.uniforms.quads.value?.dispose();
      material.dispose();
    }
    this.colours.dispose();
    this.renderer.dispose();
  }
}
