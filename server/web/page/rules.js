// Which options go together: the server's rules, so that the form offers nothing that it refuses. The server decides.

const WHOLE = ['U8', 'U16', 'U32'], FLOATS = ['F16', 'F32'];
const COLOURS = new Set(['base_color', 'emissive', 'color', 'constant']);
const DIRECTIONS = new Set(['normal', 'geometric_normal', 'tangent']);
const NOT_ENCODED = new Set(['BLEND_COUNT', 'BLEND_AND', 'BLEND_OR']);
const SHARED_BLENDS = ['REPLACE', 'FIRST', 'COUNT'];
const ORDERED = ['AVERAGE', 'MIN', 'MAX', 'ADD'], BITWISE = ['OR', 'AND'];
const ALL_FILLS = ['FILL_NONE', 'FILL_PARITY', 'FILL_NONZERO', 'FILL_FLOOD'];

export const MAX_TARGETS = 8;

// The fills of a coverage and of parts. The first one is taken where another one is no longer possible.
export function fillsOf(coverage, parts) {
  if (coverage === 'COVERAGE_NONE') return ['FILL_PARITY', 'FILL_NONZERO'];
  return parts === 'PART_SCOPE_WHOLE' ? ALL_FILLS : ALL_FILLS.filter((fill) => fill !== 'FILL_FLOOD');
}

// The blends of a VoxelFormat; the first one is its default.
export function blendsOf(format) {
  const kind = wordOf(format);
  const blends = kind === 'BIT' ? ['OR', 'AND', ...SHARED_BLENDS]
    : [...SHARED_BLENDS, ...ORDERED, ...(FLOATS.includes(kind) ? [] : BITWISE)];
  return blends.map((blend) => `BLEND_${blend}`);
}

// The encodings of a target; the first one keeps most of the values.
export function encodingsOf({shader, format, blend}) {
  const kind = wordOf(format);
  const encodings = ['ENCODING_LINEAR'];
  if (!WHOLE.includes(kind) || kind === 'U32' || NOT_ENCODED.has(blend)) return encodings;
  if (COLOURS.has(shader) && kind === 'U8') encodings.unshift('ENCODING_SRGB');
  if (DIRECTIONS.has(shader)) encodings.unshift('ENCODING_SNORM');
  return encodings;
}

// What the picture shows of these targets, as a sentence. It takes colours from those that are no bits.
export function shownText({coverage, targets}) {
  if (targets.length === 0) {
    return coverage === 'COVERAGE_NONE' ? 'The picture shows the shape alone: no triangle gives a voxel its colour.'
      : 'The picture shows the colours of the mesh, white where it has none.';
  }
  const values = targets.filter(({format}) => format !== 'VOXEL_FORMAT_BIT').map(({shader}) => shader.name);
  if (values.length === 0) return 'The picture shows the shape alone: bits have no colour.';
  return `The picture shows ${values[0]}${values.length > 1 ? `, then by choice ${values.slice(1).join(', ')}` : ''}.`;
}

const wordOf = (value) => value.split('_').pop();
