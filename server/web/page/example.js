// A mesh to begin with: a trefoil knot as a tube with vertex colours, made here so that the page loads no file for it.
//
// Source: Khronos Group, "glTF 2.0 Specification", 2021: GLB, accessors.

const RINGS = 160, SIDES = 14;
const TUBE_RADIUS = 0.45;
const FLOAT = 5126, UNSIGNED_BYTE = 5121, UNSIGNED_SHORT = 5123;
const ARRAY_BUFFER = 34962, ELEMENT_ARRAY_BUFFER = 34963;

// A File that a person could have chosen.
export function exampleMesh() {
  const {positions, colours, indices} = knot();
  const box = [0, 1, 2].map((axis) => positions.filter((_, n) => n % 3 === axis));
  const vertices = RINGS * SIDES;
  const views = [positions, colours, indices].map((array) => new Uint8Array(array.buffer));
  const offsets = [0, views[0].length, views[0].length + views[1].length];
  const json = {
    asset: {version: '2.0', generator: 'VoxelPipe'},
    scene: 0,
    scenes: [{nodes: [0]}],
    nodes: [{mesh: 0, name: 'knot'}],
    meshes: [{primitives: [{attributes: {POSITION: 0, COLOR_0: 1}, indices: 2}]}],
    accessors: [
      {bufferView: 0, componentType: FLOAT, count: vertices, type: 'VEC3',
        min: box.map((values) => Math.min(...values)), max: box.map((values) => Math.max(...values))},
      {bufferView: 1, componentType: UNSIGNED_BYTE, normalized: true, count: vertices, type: 'VEC4'},
      {bufferView: 2, componentType: UNSIGNED_SHORT, count: indices.length, type: 'SCALAR'},
    ],
    bufferViews: views.map((view, n) => ({buffer: 0, byteOffset: offsets[n], byteLength: view.length,
      target: n < 2 ? ARRAY_BUFFER : ELEMENT_ARRAY_BUFFER})),
    buffers: [{byteLength: offsets[2] + views[2].length}],
  };
  return new File([glbOf(json, views)], 'knot.glb', {type: 'model/gltf-binary'});
}

// The knot (2, 3) on a torus. Normals of the torus are normal to the knot too, and close where it does.
function knot() {
  const positions = new Float32Array(3 * RINGS * SIDES);
  const colours = new Uint8Array(4 * RINGS * SIDES);
  const indices = new Uint16Array(6 * RINGS * SIDES);
  const at = (t) => [(2 + Math.cos(3 * t)) * Math.cos(2 * t), (2 + Math.cos(3 * t)) * Math.sin(2 * t), Math.sin(3 * t)];
  for (let ring = 0; ring < RINGS; ++ring) {
    const t = 2 * Math.PI * ring / RINGS;
    const centre = at(t);
    const normal = [Math.cos(3 * t) * Math.cos(2 * t), Math.cos(3 * t) * Math.sin(2 * t), Math.sin(3 * t)];
    const [before, after] = [at(t - 1e-4), at(t + 1e-4)];
    const side = unit(cross(after.map((value, axis) => value - before[axis]), normal));
    for (let n = 0; n < SIDES; ++n) {
      const vertex = ring * SIDES + n;
      const angle = 2 * Math.PI * n / SIDES;
      const [u, v] = [TUBE_RADIUS * Math.cos(angle), TUBE_RADIUS * Math.sin(angle)];
      positions.set(centre.map((value, axis) => value + u * normal[axis] + v * side[axis]), 3 * vertex);
      const hue = [0, 1, 2].map((c) => 255 * (0.5 + 0.5 * Math.cos(t - 2 * Math.PI * c / 3)) ** 2);
      colours.set([...hue.map(Math.round), 255], 4 * vertex);
      const [next, over] = [(ring + 1) % RINGS * SIDES, (n + 1) % SIDES];
      const [a, b, c, d] = [vertex, ring * SIDES + over, next + n, next + over];
      indices.set([a, b, c, b, d, c], 6 * vertex);
    }
  }
  return {positions, colours, indices};
}

function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

function unit(a) {
  return a.map((value) => value / Math.hypot(...a));
}

// In: the document, and the parts of its buffer, each of whole words. Out: a Blob.
function glbOf(json, parts) {
  let text = new TextEncoder().encode(JSON.stringify(json));
  text = new Uint8Array([...text, ...Array((4 - text.length % 4) % 4).fill(0x20)]);
  const bytes = parts.reduce((sum, part) => sum + part.length, 0);
  const words = (...values) => new Uint8Array(Uint32Array.from(values).buffer); // little endian, as all browsers' are
  const [magic, jsonChunk, binChunk] = [0x46546c67, 0x4e4f534a, 0x004e4942];
  return new Blob([words(magic, 2, 12 + 8 + text.length + 8 + bytes), words(text.length, jsonChunk), text,
    words(bytes, binChunk), ...parts]);
}
