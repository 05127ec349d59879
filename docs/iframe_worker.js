/**
 * Search runs in a worker, which browsers refuse to pages that are read from a folder: there its script runs in a frame
 * instead.
 */
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      this.frame.title = "search";
      document.body.append(this.frame);
      const inner = this.frame.contentWindow;
      const base = new URL(url, document.baseURI);
      const load = (source) =>
        new Promise((resolve, reject) => {
          const script = inner.document.createElement("script");
          script.src = new URL(source, base);
          script.onload = resolve;
          script.onerror = () => reject(new Error(`${source} cannot be loaded`));
          inner.document.head.append(script);
        });
      inner.importScripts = (...sources) =>
        sources.reduce((before, source) => before.then(() => load(source)), Promise.resolve());
      inner.postMessage = (data) => this.answer(data);
      this.ready = load(base);
    }

    answer(data) {
      const event = new MessageEvent("message", { data });
      this.dispatchEvent(event);
      this.onmessage?.(event);
    }

    postMessage(data) {
      this.ready.then(() => {
        const inner = this.frame.contentWindow;
        const event = new inner.MessageEvent("message", { data });
        inner.dispatchEvent(event);
      });
    }

    terminate() {
      this.frame.remove();
    }
  };
}
