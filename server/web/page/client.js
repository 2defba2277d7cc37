// The calls of the page: gRPC-Web for the service, and the endpoint of files.
//
// Source: gRPC, "gRPC Web", PROTOCOL-WEB.md: a frame is a byte of flags, the length in four bytes, the larger first,
// and a message; the flag 128 marks the trailers.
import {joined, Messages} from './messages.js';

const SERVICE = '/voxelpipe.v1.VoxelizationService/';
const INVALID_ARGUMENT = 3, NOT_FOUND = 5, PERMISSION_DENIED = 7, RESOURCE_EXHAUSTED = 8, UNAUTHENTICATED = 16;
const TRAILERS = 128;
// google.rpc.Status and BadRequest, as far as the page reads them.
const STATUS = new Messages({enums: {}, messages: {
  Status: {details: {number: 3, type: 'message', of: 'Any', repeated: true}},
  Any: {type_url: {number: 1, type: 'string'}, value: {number: 2, type: 'bytes'}},
  BadRequest: {field_violations: {number: 1, type: 'message', of: 'FieldViolation', repeated: true}},
  FieldViolation: {field: {number: 1, type: 'string'}, description: {number: 2, type: 'string'}},
}});

export class CallError extends Error {
  // In: the gRPC code, the message, and the value of grpc-status-details-bin, if there is one.
  constructor(code, message, details) {
    super(message);
    this.violations = violationsOf(details); // [{field, description}]: the fields of the request at fault
    this.needsToken = code === UNAUTHENTICATED;
    this.invalid = code === INVALID_ARGUMENT;
    this.missing = code === NOT_FOUND;
    this.exhausted = code === RESOURCE_EXHAUSTED;
    this.denied = code === PERMISSION_DENIED;
  }
}

// /facts.json. Throws a CallError.
export async function readFacts() {
  const response = await fetch('/facts.json');
  if (!response.ok) throw await errorOf(response);
  return response.json();
}

export class Server {
  // In: the object of /facts.json, and a function that returns the token, empty if there is none.
  constructor(facts, token) {
    this.messages = new Messages(facts);
    this.methods = facts.methods;
    this.token = token;
  }

  // The answers of a call, one after the other. Throws a CallError, or an AbortError.
  async *call(method, request, signal) {
    const names = this.methods[method];
    const bytes = this.messages.encode(names.request, request);
    const head = new Uint8Array(5);
    new DataView(head.buffer).setUint32(1, bytes.length);
    const response = await fetch(SERVICE + method, {
      method: 'POST',
      signal,
      headers: {...this.#headers(), 'content-type': 'application/grpc-web+proto', 'x-grpc-web': '1'},
      body: new Blob([head, bytes]),
    });
    if (!response.ok) throw await errorOf(response);
    check(response.headers);
    let trailers;
    for await (const [flags, frame] of framesOf(response.body)) {
      if (flags & TRAILERS) trailers = headersOf(frame);
      else yield this.messages.decode(names.response, frame);
    }
    if (!trailers) throw new CallError(null, 'the connection ended before the answer did');
    check(trailers);
  }

  async one(method, request, signal) {
    let answer;
    for await (const message of this.call(method, request, signal)) answer = message;
    return answer;
  }

  // The result of a VoxelizeRequest as a file of this format: its `blob`, its `name`, "result.npz" (several files are
  // one .zip), and the `summary` of the call.
  async file(format, request, signal) {
    const response = await fetch(`/file?format=${encodeURIComponent(format)}`, {
      method: 'POST',
      signal,
      headers: {...this.#headers(), 'content-type': 'application/x-protobuf'},
      body: this.messages.encode('VoxelizeRequest', request),
    });
    if (!response.ok) throw await errorOf(response);
    const name = /filename="([^"]*)"/.exec(response.headers.get('content-disposition') ?? '')?.[1];
    const summary = this.messages.decode('Summary', binary(response.headers.get('voxelpipe-summary-bin') ?? ''));
    return {blob: await response.blob(), name: name ?? 'result', summary};
  }

  #headers() {
    return this.token() ? {authorization: `Bearer ${this.token()}`} : {};
  }
}

// The error of a response that is none of a call: the server's own are a text with the gRPC status in the headers. What
// a proxy says is a page for itself.
async function errorOf(response) {
  const status = response.headers.get('grpc-status') ?? (response.status === 401 ? UNAUTHENTICATED : null);
  const type = response.headers.get('content-type') ?? '';
  const text = type.startsWith('text/plain') ? (await response.text()).trim() : '';
  return new CallError(Number(status), text || `the server refused the request: HTTP ${response.status}`,
    response.headers.get('grpc-status-details-bin'));
}

// A binary value of a header: base64, with or without padding.
function binary(text) {
  return Uint8Array.from(atob(text), (byte) => byte.charCodeAt(0));
}

function headersOf(bytes) {
  return new Map(new TextDecoder().decode(bytes).split('\r\n').map((line) => {
    const colon = line.indexOf(':');
    return [line.slice(0, colon).toLowerCase(), line.slice(colon + 1).trim()];
  }));
}

// In: a Map of trailers, or Headers.
function check(headers) {
  const status = headers.get('grpc-status');
  if (!status || status === '0') return;
  throw new CallError(Number(status), unescaped(headers.get('grpc-message') ?? '') || `status ${status}`,
    headers.get('grpc-status-details-bin'));
}

// Details that cannot be read tell nothing: the message is there.
function violationsOf(details) {
  if (!details) return [];
  try {
    return STATUS.decode('Status', binary(details)).details.filter(({type_url: type}) => /BadRequest$/.test(type))
      .flatMap(({value}) => STATUS.decode('BadRequest', value).field_violations);
  } catch {
    return [];
  }
}

// PROTOCOL-HTTP2.md, Percent-Encoded: what is not valid stays as it is.
function unescaped(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}

async function* framesOf(stream) {
  const reader = stream.getReader();
  let kept = new Uint8Array(0);
  let parts = [];
  let size = 0;
  for (;;) {
    const {done, value} = await reader.read();
    if (done) return;
    parts.push(value);
    size += value.length;
    // Joined only when a frame is complete: a large one comes in many parts.
    const head = parts[0].length >= 5 ? parts[0] : joined(parts);
    if (size < 5 || size < 5 + new DataView(head.buffer, head.byteOffset).getUint32(1)) continue;
    kept = joined(parts);
    while (kept.length >= 5) {
      const length = new DataView(kept.buffer, kept.byteOffset).getUint32(1);
      if (kept.length < 5 + length) break;
      yield [kept[0], kept.subarray(5, 5 + length)];
      kept = kept.subarray(5 + length);
    }
    parts = kept.length > 0 ? [kept] : [];
    size = kept.length;
  }
}
