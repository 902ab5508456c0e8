// The live stream. It hears something at least four times a second; silence means that what is shown is old.

export const STALE_MS = 800; // shown as old within one second, with the 100 ms of the clock that looks
const GIVE_UP_MS = 2000; // a line that says nothing for so long is opened anew
const KNOCK_MS = 500;

export class Stream {
  #source = null;
  #heard = 0;
  #opened = 0;

  constructor(onEvent) {
    this.onEvent = onEvent;
    this.#open();
    setInterval(() => this.#watch(), KNOCK_MS);
  }

  // Milliseconds since the daemon was last heard.
  get age() {
    return performance.now() - this.#heard;
  }

  get live() {
    return this.#heard > 0 && this.age < STALE_MS;
  }

  #open() {
    this.#source?.close();
    this.#opened = performance.now();
    this.#source = new EventSource("/stream");
    for (const kind of ["now", "survey"]) {
      this.#source.addEventListener(kind, (event) => {
        this.#heard = performance.now();
        this.onEvent(kind, JSON.parse(event.data));
      });
    }
  }

  #watch() {
    const silent = performance.now() - Math.max(this.#heard, this.#opened) > GIVE_UP_MS;
    if (silent || this.#source.readyState === EventSource.CLOSED) this.#open();
  }
}
