// Rectangles of voxel faces: what the scene draws.
//
// A payload lists the exposed voxels of a solid alone, in linear order, with their exposed sides. A row along x is
// solid from a voxel whose +x side is covered to the next voxel of the list: so the list also tells where the inside
// is.

export const WORDS = 4; // of a rectangle: x | y << 16, z | length << 16, 1 + its first voxel or 0 (the inside), unused

const SIDE_BIT = 3; // the place of the bits of the sides in a cell

class Quads {
  #words;
  count = 0;

  constructor(most) {
    this.#words = new Uint32Array(WORDS * most);
  }

  add(x, y, z, length, source) {
    if (WORDS * (this.count + 1) > this.#words.length) {
      const more = new Uint32Array(2 * this.#words.length + WORDS);
      more.set(this.#words);
      this.#words = more;
    }
    const at = WORDS * this.count++;
    this.#words[at] = x | y << 16;
    this.#words[at + 1] = z | length << 16;
    this.#words[at + 2] = source;
  }

  lengthen() {
    this.#words[WORDS * this.count - 3] += 1 << 16;
  }

  get words() {
    return this.#words.subarray(0, WORDS * this.count);
  }
}

// The axis along which the rectangles of a side extend.
export const runAxis = (side) => (side < 2 ? 1 : 0);

// The exposed faces of a side, one by one: joined, their corners would meet edges of others, which leaves gaps. Out:
// `words` of rectangles.
export function exposedQuads({cells, voxels}, side) {
  let faces = 0;
  for (let n = 0; n < voxels; ++n) faces += (cells[4 * n + SIDE_BIT] >> side) & 1;
  const quads = new Quads(faces);
  for (let at = 0; at < 4 * voxels; at += 4) {
    if ((cells[at + SIDE_BIT] >> side) & 1) quads.add(cells[at], cells[at + 1], cells[at + 2], 1, at / 4 + 1);
  }
  return quads.words;
}

// The faces of this side that the layer `layer` of its axis shows where a slice ends there and the solid goes on.
// Out: `words` of rectangles, and whether voxels `inside` are among them.
export function cutQuads({cells, voxels}, side, layer) {
  const axis = side >> 1;
  const quads = new Quads(1024);
  let inside = false;
  let [lastY, lastZ] = [-1, -1]; // of the last rectangle, where it is inside
  for (let at = 0; at < 4 * voxels; at += 4) {
    const sides = cells[at + SIDE_BIT];
    if (cells[at + axis] === layer && ((sides >> side) & 1) === 0) {
      quads.add(cells[at], cells[at + 1], cells[at + 2], 1, at / 4 + 1);
      lastZ = -1;
    }
    if (sides & 2) continue;
    // Inside are the voxels between this one and the next.
    const from = cells[at] + 1, to = cells[at + 4];
    if (axis === 0 ? layer < from || layer >= to : cells[at + axis] !== layer || from >= to) continue;
    inside = true;
    if (axis !== 0) {
      quads.add(from, cells[at + 1], cells[at + 2], to - from, 0);
    } else {
      if (cells[at + 2] === lastZ && cells[at + 1] === lastY + 1) quads.lengthen();
      else quads.add(layer, cells[at + 1], cells[at + 2], 1, 0);
      lastY = cells[at + 1];
      lastZ = cells[at + 2];
    }
  }
  return {words: quads.words, inside};
}
