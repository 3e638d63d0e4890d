// The core behind the page: the worker that runs it, questions to it, and the words of its tables.
const Core = (() => {
  const waiting = new Map();
  let port = null, words = null, next = 0;

  async function start() {
    const packed = document.getElementById("wasm"), text = packed.content.textContent;
    packed.remove();
    const bytes = Uint8Array.fromBase64?.(text) ?? Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
    const unpacked = await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
    const module = await WebAssembly.compile(unpacked);
    const script = document.getElementById("worker").content.textContent;
    port = new Worker(URL.createObjectURL(new Blob([script], { type: "text/javascript" })));
    port.onmessage = ({ data: found }) => {
      const asked = waiting.get(found.id);
      if (found.progress) return asked?.progress?.(found.progress);
      waiting.delete(found.id);
      if ("error" in found) asked?.reject(new Error(found.error));
      else asked?.resolve(found.value);
    };
    const memoryLimit = navigator.deviceMemory && navigator.deviceMemory <= 4 ? 300 << 20 : 1 << 30;
    words = await request("start", { module, memoryLimit });
  }

  function request(call, content = {}, progress = null) {
    return new Promise((resolve, reject) => {
      const id = ++next;
      waiting.set(id, { resolve, reject, progress });
      port.postMessage({ id, call, ...content });
    });
  }

  // Ends what is being decoded: the page goes on at once, the worker after the block that it is at.
  function cancel() {
    request("cancel");
    for (const [id, asked] of waiting) {
      if (!asked.progress) continue;
      waiting.delete(id);
      asked.resolve({ cancelled: true });
    }
  }

  const ask = (question) => request("ask", { question });

  return { start, request, cancel, ask, get words() { return words; } };
})();
