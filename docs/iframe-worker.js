// Search on pages that are opened from the file system: browsers refuse workers there, so the worker's script runs in a
// hidden frame. The name is the one that mkdocs-material's plugin `offline` looks for; without it, it loads another's.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.documentElement.append(frame);
      this.scope = frame.contentWindow;
      this.scope.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      this.scope.importScripts = (...urls) => this.load(...urls);
      this.ready = this.load(url);
    }

    async load(...urls) {
      for (const url of urls) {
        const script = this.scope.document.createElement("script");
        script.src = new URL(url, location.href);
        await new Promise((done, failed) => {
          script.onload = done;
          script.onerror = failed;
          this.scope.document.documentElement.append(script);
        });
      }
    }

    async postMessage(data) {
      await this.ready;
      this.scope.dispatchEvent(new MessageEvent("message", { data }));
    }
  };
}
