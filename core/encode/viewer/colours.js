// The colours of voxels by the values of a target, by the rules of the program's pictures (core/encode/png_preview.h).

// Even samples of matplotlib's viridis (N. Smith, S. van der Walt, 2015).
export const MAP = [0x440154, 0x472d7b, 0x3b528b, 0x2c728e, 0x21918c, 0x28ae80, 0x5ec962, 0xaddc30, 0xfde725];
const PLAIN = [0x5f, 0x95, 0xc4];
const NO_LABEL = [0xc9, 0xc3, 0xb8]; // of a number that is no part's label

const channels = (rgb) => [rgb >> 16, (rgb >> 8) & 255, rgb & 255];

function mapped(share) {
  const place = Math.min(Math.max(share, 0), 1) * (MAP.length - 1);
  const index = Math.min(Math.floor(place), MAP.length - 2);
  const [from, to] = [channels(MAP[index]), channels(MAP[index + 1])];
  return from.map((value, c) => Math.round(value + (to[c] - value) * (place - index)));
}

function toSrgb(linear) {
  const v = Math.min(Math.max(linear, 0), 1);
  return Math.round(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));
}

// The number of voxel n that a colour map shows: its first component, or the length of a vector.
export function numberOf(target, n) {
  const first = n * target.components;
  if (target.shows !== 'length') return target.values[first];
  return Math.hypot(...target.values.subarray(first, first + 3));
}

// In: a read payload. Out: a Map from each label of the parts to its entry; empty if the result has none.
export const labelsOf = (data) => new Map((data.labels ?? []).map((entry) => [entry.label, entry]));

// In: a target of the payload (null: none), the number of voxels, and the payload's entries by label (labelsOf). Out:
// RGBA bytes by voxel, sRGB, and the range [low, high] where a colour map was used.
export function coloursOf(target, voxels, labels) {
  const rgba = new Uint8Array(4 * voxels).fill(255);
  let range = null;
  let colour = () => PLAIN;
  if (target && (target.shows === 'number' || target.shows === 'length')) {
    let [low, high] = [Infinity, -Infinity];
    for (let n = 0; n < voxels; ++n) {
      const value = numberOf(target, n);
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
    if (low <= high) range = [low, high];
    const table = Array.from({length: 256}, (_, i) => mapped(i / 255));
    colour = (n) => table[high > low ? Math.round(255 * (numberOf(target, n) - low) / (high - low)) : 0];
  } else if (target && target.shows === 'label') {
    const table = new Map([...labels].map(([label, entry]) => [label, channels(entry.colour)]));
    colour = (n) => table.get(target.values[n]) ?? NO_LABEL;
  } else if (target) {
    const {values, components, unit, shows} = target;
    const convert = {
      codes: (value) => Math.round(255 * value / unit),
      unit_vector: (value) => Math.round(255 * Math.min(Math.max(0.5 + 0.5 * value, 0), 1)),
      linear: (value) => toSrgb(value / unit),
    }[shows];
    colour = (n) => [0, 1, 2].map((c) => convert(values[n * components + c]));
  }
  for (let n = 0; n < voxels; ++n) rgba.set(colour(n), 4 * n);
  return {rgba, range};
}
