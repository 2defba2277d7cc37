// A mesh of the page: stored on the server once, then named; sent with every request where the server stores none.

// By extension of a file, for contents that show no format.
const FORMATS = new Map([['drc', 'MESH_FORMAT_DRACO']]);
for (const name of ['glb', 'gltf', 'stl', 'ply', 'off', 'obj', '3mf']) {
  FORMATS.set(name, `MESH_FORMAT_${name.toUpperCase()}`);
}

export class PageMesh {
  #server;
  #bytes;
  #named; // the format that the file's name tells
  #told = undefined; // the same, once the server has asked for it
  #storing = null; // the promise of CreateMesh: the name of the stored mesh, or null where the server stores none
  #sending = null; // AbortController of CreateMesh

  // In: a Server, the name of the file, and its contents, a Uint8Array.
  constructor(server, fileName, bytes) {
    this.#server = server;
    this.#bytes = bytes;
    this.name = fileName.replace(/\.[^.]*$/, '');
    this.#named = FORMATS.get(fileName.slice(this.name.length + 1).toLowerCase());
  }

  get size() {
    return this.#bytes.length;
  }

  // In: an async function that makes a call with a MeshSource. Out: what it returns. Calls it again where the server
  // has evicted the mesh, and with the format that the file's name tells where the content shows none. Storing goes on
  // when `signal` aborts: the next call needs it.
  async use(call, signal) {
    for (let attempt = 0; attempt < 2; ++attempt) {
      const name = await orAborted(this.#stored(), signal);
      if (name === null) break;
      try {
        return await call({stored: {name}});
      } catch (error) {
        if (!error.missing) throw error;
        this.forget();
      }
    }
    return this.#withFormat((bytes) => call({bytes}));
  }

  // The next call stores the mesh again.
  forget() {
    this.#storing = null;
  }

  // Sends no more of a mesh that is not needed now.
  discard() {
    this.#sending?.abort();
  }

  #stored() {
    if (this.#storing) return this.#storing;
    const storing = this.#store().catch((error) => {
      if (this.#storing === storing && !error.invalid) this.forget(); // what is no mesh is not sent again
      throw error;
    });
    return (this.#storing = storing);
  }

  async #store() {
    const {signal} = (this.#sending = new AbortController());
    try {
      const create = (mesh) => this.#server.one('CreateMesh', {mesh}, signal);
      return (await this.#withFormat(create)).name;
    } catch (error) {
      if (error.exhausted || error.denied) return null;
      throw error;
    }
  }

  // In: an async function that makes a call with MeshBytes.
  async #withFormat(call) {
    const meshBytes = () => ({data: this.#bytes, format: this.#told});
    try {
      return await call(meshBytes());
    } catch (error) {
      if (!error.invalid || this.#told || !this.#named) throw error;
      this.#told = this.#named;
      try {
        return await call(meshBytes());
      } catch (second) {
        if (second.invalid) this.#told = undefined;
        throw second.invalid ? error : second;
      }
    }
  }
}

// The promise, or the signal's reason if it aborts first.
function orAborted(promise, signal) {
  return new Promise((resolve, reject) => {
    if (signal?.aborted) reject(signal.reason);
    signal?.addEventListener('abort', () => reject(signal.reason), {once: true});
    promise.then(resolve, reject);
  });
}
