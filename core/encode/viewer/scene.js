// Exposed faces of voxels with WebGL 2: a draw call for each of the six directions. Vertices read the voxels from
// textures; instances of four vertices each would be slow where WebGL runs in software.
import {
  BufferGeometry, Color, DataTexture, DoubleSide, GLSL3, Mesh, OrthographicCamera, RawShaderMaterial, RedIntegerFormat,
  RGBAFormat, RGBAIntegerFormat, Scene, UnsignedByteType, UnsignedIntType, UnsignedShortType, Vector3, WebGLRenderer,
  WebGLRenderTarget,
} from 'three';

const TEXTURE_WIDTH = 2048;

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
uniform usampler2D cells, faces;  // by voxel; the voxels of this side's faces
uniform sampler2D colours;        // by voxel
uniform mat4 projectionMatrix, modelViewMatrix;
uniform vec3 voxelSize, low, high, corners[4];
uniform int side;
uniform bool picks;
flat out vec4 shown;
ivec2 place(int n) {
  return ivec2(n % ${TEXTURE_WIDTH}, n / ${TEXTURE_WIDTH});
}
void main() {
  int face = gl_VertexID / 6, corner = gl_VertexID % 6;
  int voxel = int(texelFetch(faces, place(face), 0).r);
  vec3 cell = vec3(texelFetch(cells, place(voxel), 0).xyz);
  bool hidden = any(lessThan(cell, low)) || any(greaterThanEqual(cell, high));
  vec3 offset = corners[corner < 3 ? corner : corner == 3 ? 0 : corner - 2];
  gl_Position = hidden ? vec4(0.0, 0.0, 2.0, 1.0)
                       : projectionMatrix * modelViewMatrix * vec4((cell + offset) * voxelSize, 1.0);
  shown = picks ? vec4(face & 255, (face >> 8) & 255, (face >> 16) & 255, side + 1) / 255.0
                : vec4(texelFetch(colours, place(voxel), 0).rgb, 1.0);
}`;

const FRAGMENT = `
precision highp float;
flat in vec4 shown;
uniform float shade;
uniform bool picks;
out vec4 result;
void main() {
  result = picks ? shown : vec4(shown.rgb * (gl_FrontFacing ? shade : 0.45 * shade), 1.0);
}`;

// In: numbers of `items` entries. Out: a texture of them, row after row.
function tableOf(array, items, format, type, internalFormat) {
  const height = Math.max(1, Math.ceil(items / TEXTURE_WIDTH));
  const padded = new array.constructor(array.length / Math.max(items, 1) * TEXTURE_WIDTH * height || 4 * TEXTURE_WIDTH);
  padded.set(array);
  const texture = new DataTexture(padded, TEXTURE_WIDTH, height, format, type);
  if (internalFormat) texture.internalFormat = internalFormat;
  texture.needsUpdate = true;
  return texture;
}

export class VoxelScene {
  // In: a canvas, and a read payload. Throws an Error if the browser has no WebGL 2.
  constructor(canvas, data) {
    const context = canvas.getContext('webgl2', {antialias: true});
    if (!context) throw new Error('this browser has no WebGL 2');
    this.renderer = new WebGLRenderer({canvas, context});
    this.data = data;
    const largest = Math.max(...data.voxel_size);
    this.voxelSize = new Vector3(...data.voxel_size.map((size) => size / largest));
    this.box = new Vector3(...data.dims).multiply(this.voxelSize);
    this.low = new Vector3(0, 0, 0);
    this.high = new Vector3(...data.dims);
    this.camera = new OrthographicCamera();
    this.scene = new Scene();
    this.scene.background = new Color(0xe9edf1);
    this.pickTarget = new WebGLRenderTarget(1, 1);
    const {voxels} = data;
    this.cells = tableOf(data.cells, voxels, RGBAIntegerFormat, UnsignedShortType, 'RGBA16UI');
    this.colours = tableOf(new Uint8Array(4 * voxels), voxels, RGBAFormat, UnsignedByteType);
    this.sides = SIDES.map((side, number) => this.#addSide(side, number));
    this.faces = this.sides.reduce((sum, side) => sum + side.voxels.length, 0);
  }

  #addSide({corners, shade}, number) {
    const {cells, voxels: count} = this.data;
    let faces = 0;
    for (let n = 0; n < count; ++n) faces += (cells[4 * n + 3] >> number) & 1;
    const voxels = new Uint32Array(faces);
    for (let n = 0, f = 0; n < count; ++n) {
      if ((cells[4 * n + 3] >> number) & 1) voxels[f++] = n;
    }
    const geometry = new BufferGeometry();
    geometry.setDrawRange(0, 6 * faces);
    const material = new RawShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      side: DoubleSide,
      uniforms: {
        cells: {value: this.cells},
        colours: {value: this.colours},
        faces: {value: tableOf(voxels, faces, RedIntegerFormat, UnsignedIntType, 'R32UI')},
        corners: {value: corners.map((corner) => new Vector3(...corner))},
        voxelSize: {value: this.voxelSize}, low: {value: this.low}, high: {value: this.high}, side: {value: number},
        shade: {value: shade}, picks: {value: false},
      },
    });
    const mesh = new Mesh(geometry, material);
    mesh.frustumCulled = false;
    if (faces > 0) this.scene.add(mesh);
    return {voxels, geometry, material};
  }

  // In: RGBA bytes by voxel.
  setColours(rgba) {
    this.colours.image.data.set(rgba);
    this.colours.needsUpdate = true;
  }

  // Hides voxels whose index on this axis is below `from` or at least `to`.
  setSlice(axis, from, to) {
    this.low.setComponent(axis, from);
    this.high.setComponent(axis, to);
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
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    const half = 0.55 * this.box.length();
    const [x, y] = width > height ? [half * width / height, half] : [half, half * height / width];
    Object.assign(this.camera, {left: -x, right: x, top: y, bottom: -y});
    this.camera.updateProjectionMatrix();
    this.size = [width, height];
  }

  render() {
    this.renderer.render(this.scene, this.camera);
  }

  // The voxel at a point of the canvas, in CSS pixels; -1 if there is none.
  pick(x, y) {
    const [width, height] = this.size;
    const background = this.scene.background;
    this.camera.setViewOffset(width, height, x, y, 1, 1);
    for (const {material} of this.sides) material.uniforms.picks.value = true;
    this.scene.background = null;
    this.renderer.setRenderTarget(this.pickTarget);
    this.renderer.setClearColor(0, 0);
    this.renderer.clear();
    this.renderer.render(this.scene, this.camera);
    const pixel = new Uint8Array(4);
    this.renderer.readRenderTargetPixels(this.pickTarget, 0, 0, 1, 1, pixel);
    this.renderer.setRenderTarget(null);
    this.scene.background = background;
    for (const {material} of this.sides) material.uniforms.picks.value = false;
    this.camera.clearViewOffset();
    if (pixel[3] === 0) return -1;
    return this.sides[pixel[3] - 1].voxels[pixel[0] | pixel[1] << 8 | pixel[2] << 16];
  }

  dispose() {
    for (const {geometry, material} of this.sides) {
      geometry.dispose();
      material.uniforms.faces.value.dispose();
      material.dispose();
    }
    this.cells.dispose();
    this.colours.dispose();
    this.pickTarget.dispose();
    this.renderer.dispose();
  }
}
