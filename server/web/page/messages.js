// Messages of voxelpipe.v1 as plain objects. Field numbers and types come from the server (/facts.json), which has them
// from the .proto files; names are theirs, also those of enums' values. 64-bit integers become numbers.
//
// Source: Google, "Protocol Buffers: Encoding", 2008 to 2025.

const VARINT = 0, FIXED64 = 1, BYTES = 2, FIXED32 = 5;
const DEFAULTS = {string: '', bytes: new Uint8Array(0), double: 0, fixed32: 0}; // of others that of the varint 0
const WIRE_TYPES = {double: FIXED64, fixed32: FIXED32, string: BYTES, bytes: BYTES, message: BYTES};

export class Messages {
  // In: the object of /facts.json.
  constructor({messages, enums}) {
    this.messages = messages;
    this.enums = enums;
    this.names = {}; // of the values of each enum, by number
    for (const [name, values] of Object.entries(enums)) {
      this.names[name] = new Map(Object.entries(values).map(([value, number]) => [number, value]));
    }
  }

  // In: the name of a message, and its fields. Fields that are undefined are left out. Throws an Error for a name that
  // the message does not have.
  encode(name, fields) {
    const parts = [];
    for (const [key, value] of Object.entries(fields)) {
      const field = this.messages[name][key];
      if (!field) throw new Error(`${name} has no field ${key}`);
      const values = value === undefined ? [] : field.repeated ? value : [value];
      for (const one of values) parts.push(...this.#encodeField(field, one));
    }
    return joined(parts);
  }

  #encodeField(field, value) {
    const wire = WIRE_TYPES[field.type] ?? VARINT;
    const tag = varint(field.number * 8 + wire);
    if (wire === BYTES) {
      const bytes = field.type === 'message' ? this.encode(field.of, value)
        : field.type === 'string' ? new TextEncoder().encode(value) : value;
      return [tag, varint(bytes.length), bytes];
    }
    if (wire !== VARINT) {
      const view = new DataView(new ArrayBuffer(wire === FIXED64 ? 8 : 4));
      if (wire === FIXED64) view.setFloat64(0, value, true);
      else view.setUint32(0, value, true);
      return [tag, new Uint8Array(view.buffer)];
    }
    return [tag, varint(field.type === 'enum' ? this.enums[field.of][value] : Number(value))];
  }

  // Out: the fields that the bytes hold; absent ones have their defaults, absent messages are undefined. Values of
  // enums that the server's description does not name stay numbers. Throws a RangeError if the bytes end within a
  // field.
  decode(name, bytes) {
    const fields = this.messages[name];
    const byNumber = new Map(Object.entries(fields).map(([key, field]) => [field.number, [key, field]]));
    const message = {};
    for (const [key, field] of Object.entries(fields)) {
      if (field.repeated) message[key] = [];
      else if (field.type !== 'message') message[key] = DEFAULTS[field.type] ?? this.#value(field, 0);
    }
    const reader = new Reader(bytes);
    while (!reader.done()) {
      const tag = reader.varint();
      const wire = tag % 8;
      const [key, field] = byNumber.get(Math.floor(tag / 8)) ?? [];
      const raw = reader.take(wire);
      if (!field) continue;
      const packed = wire === BYTES && (WIRE_TYPES[field.type] ?? VARINT) !== BYTES;
      const values = packed ? this.#unpacked(field, raw) : [this.#value(field, raw)];
      if (field.repeated) message[key].push(...values);
      else [message[key]] = values;
    }
    return message;
  }

  #unpacked(field, bytes) {
    const values = [];
    const reader = new Reader(bytes);
    while (!reader.done()) values.push(this.#value(field, reader.take(WIRE_TYPES[field.type] ?? VARINT)));
    return values;
  }

  #value(field, raw) {
    switch (field.type) {
      case 'message': return this.decode(field.of, raw);
      case 'string': return new TextDecoder().decode(raw);
      case 'bool': return raw !== 0;
      case 'enum': return this.names[field.of].get(raw) ?? raw;
      case 'double': return new DataView(raw.buffer, raw.byteOffset).getFloat64(0, true);
      case 'fixed32': return new DataView(raw.buffer, raw.byteOffset).getUint32(0, true);
      default: return raw;
    }
  }
}

class Reader {
  constructor(bytes) {
    this.bytes = bytes;
    this.at = 0;
  }

  done() {
    return this.at >= this.bytes.length;
  }

  varint() {
    let [value, scale] = [0, 1];
    for (;;) {
      if (this.done()) throw new RangeError('a message ends within a number');
      const byte = this.bytes[this.at++];
      value += (byte & 127) * scale;
      scale *= 128;
      if (byte < 128) return value;
    }
  }

  // The contents of a field of this wire type.
  take(wire) {
    if (wire === VARINT) return this.varint();
    const size = wire === FIXED64 ? 8 : wire === FIXED32 ? 4 : wire === BYTES ? this.varint() : NaN;
    if (!(size <= this.bytes.length - this.at)) throw new RangeError('a message ends within a field');
    this.at += size;
    return this.bytes.subarray(this.at - size, this.at);
  }
}

// Not negative, below 2^53.
function varint(value) {
  const bytes = [];
  for (; value >= 128; value = Math.floor(value / 128)) bytes.push(128 + (value % 128));
  return Uint8Array.from([...bytes, value]);
}

export function joined(parts) {
  const all = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    all.set(part, at);
    at += part.length;
  }
  return all;
}
