// Frames on demand, one at a time: coarse while something moves, if the device is slow, and sharp once it rests.

const SHARP = 2; // pixels of the picture for one of CSS, each way: smooth edges
const COARSE = 0.5;
const MAX_PIXELS = 2 ** 24;
const [QUICK_MS, SLOW_MS] = [15, 50]; // of a frame while something moves
const REST_MS = 150;

export class Frames {
  #scene;
  #ratio = 1; // while something moves
  #wanted = false;
  #drawing = false;
  #timer = 0;
  #waiting = []; // for the sharp frame

  constructor(scene) {
    this.#scene = scene;
  }

  // Asks for a frame: what is shown has changed.
  draw() {
    this.#wanted = true;
    clearTimeout(this.#timer);
    if (!this.#drawing) this.#begin();
  }

  // Out: a promise of the sharp frame of what is shown now.
  still() {
    return new Promise((done) => {
      this.#waiting.push(done);
      this.draw();
    });
  }

  stop() {
    this.#scene = null;
    clearTimeout(this.#timer);
  }

  #sharpRatio() {
    const [width, height] = this.#scene.size;
    return Math.min(SHARP, Math.sqrt(MAX_PIXELS / (width * height)));
  }

  #begin() {
    this.#drawing = true;
    requestAnimationFrame(() => {
      if (!this.#scene) return;
      const sharp = !this.#wanted;
      this.#wanted = false;
      const begin = performance.now();
      const ratio = sharp ? this.#sharpRatio() : Math.min(this.#ratio, this.#sharpRatio());
      this.#scene.render(ratio);
      // A frame waits for the one before it: where WebGL runs in software, others would pile up.
      const context = this.#scene.renderer.getContext();
      const fence = context.fenceSync(context.SYNC_GPU_COMMANDS_COMPLETE, 0);
      context.flush();
      const look = () => {
        if (!this.#scene) return;
        if (context.clientWaitSync(fence, 0, 0) === context.TIMEOUT_EXPIRED) {
          setTimeout(look, 4);
          return;
        }
        context.deleteSync(fence);
        this.#end(sharp, performance.now() - begin);
      };
      look();
    });
  }

  #end(sharp, ms) {
    this.#drawing = false;
    if (!sharp && ms > SLOW_MS) this.#ratio = Math.max(this.#ratio / 2, COARSE);
    if (!sharp && ms < QUICK_MS) this.#ratio = Math.min(this.#ratio * 2, SHARP);
    if (this.#wanted) {
      this.#begin();
    } else if (!sharp) {
      this.#timer = setTimeout(() => this.#begin(), REST_MS);
    } else {
      for (const done of this.#waiting.splice(0)) done();
    }
  }
}
