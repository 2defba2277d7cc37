// The data of a viewer file, as core/encode/drawn/html.cpp writes it.

const MAGIC = 'VXV1';

// In: the text of a .html result. Out: the inflated payload, a Uint8Array. Throws an Error if there is none.
export async function payloadOf(html) {
  const found = /<script[^>]*\bid="voxels"[^>]*>([^<]*)<\/script>/.exec(html);
  if (!found) throw new Error('the page holds no voxels');
  return inflate(found[1]);
}

// In: base64 of a zlib stream.
export async function inflate(base64) {
  const bytes = Uint8Array.from(atob(base64.trim()), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const ARRAYS = {u8: Uint8Array, u16: Uint16Array, u32: Uint32Array, f32: Float32Array};

// In: an inflated payload. Out: its description, with `cells` (Uint16Array: x, y, z and a bit for each exposed side of
// every drawn voxel) and `values` of each target (an array by voxel and component).
export function readPayload(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const magic = String.fromCharCode(...bytes.subarray(0, 4));
  if (magic !== MAGIC) throw new Error(`the data begins with '${magic}', not '${MAGIC}'`);
  const textBytes = view.getUint32(4, true);
  const description = JSON.parse(new TextDecoder().decode(bytes.subarray(8, 8 + textBytes)));
  let at = 8 + textBytes;
  const take = (type, count) => {
    const array = new ARRAYS[type](bytes.buffer, bytes.byteOffset + at, count);
    at += Math.ceil(array.byteLength / 4) * 4;
    return array;
  };
  description.cells = take('u16', 4 * description.voxels);
  for (const target of description.targets) {
    target.values = take(target.format, description.voxels * target.components);
  }
  return description;
}
