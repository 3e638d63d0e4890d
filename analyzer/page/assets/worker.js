// The worker: owns the core (WebAssembly), reads the recording in pieces, answers the page between two of them.
"use strict";
const PIECE = 1 << 20, GIGABYTE = 1 << 30;
let wasm = null, module = null, turn = 0, memoryLimit = GIGABYTE;
// The share of the recording that has been read.
let share = 1;

const encode = (value) => new TextEncoder().encode(JSON.stringify(value));

// The module stays, an instance is made for each recording: memory of WebAssembly never shrinks.
async function restart() {
  wasm = (await WebAssembly.instantiate(module, {})).exports;
  share = 1;
}

// Calls the core. Views of its memory are dead after every call, so they are made when they are needed.
function call(name, bytes) {
  const at = wasm.input(bytes ? bytes.length : 0);
  if (bytes) new Uint8Array(wasm.memory.buffer, at, bytes.length).set(bytes);
  let found;
  try {
    found = wasm[name]();
  } catch (trap) {
    const text = new Uint8Array(wasm.memory.buffer, wasm.panic_text(), wasm.panic_length());
    const message = new TextDecoder().decode(text) || String(trap.message);
    throw new Error(/alloc|memory/i.test(message) ? `too big for this tab: ${needed()} MB needed` : `the decoder failed: ${message}`);
  }
  if (found < 0) throw new Error(JSON.parse(new TextDecoder().decode(output())).error);
  return found;
}

const output = () => new Uint8Array(wasm.memory.buffer, wasm.output(), wasm.output_length());
const megabytes = () => Math.round(wasm.memory.buffer.byteLength / 1048576);
// What the whole recording would take, by what its part has taken.
const needed = () => Math.ceil(megabytes() / share);

function ask(question) {
  call("ask", encode(question));
  return JSON.parse(new TextDecoder().decode(output()));
}

// Decodes a recording; `progress` messages say how far it is. A later call of `decode` or `cancel` ends it.
async function decode(id, { blob, settings, keepFrom }) {
  const mine = ++turn;
  await restart();
  call("open", encode(settings));
  const pieces = [];
  let said = 0, rows = 0, isCut = false;
  for (let at = 0; at < blob.size && !isCut; at += PIECE) {
    const block = new Uint8Array(await blob.slice(at, at + PIECE).arrayBuffer());
    if (mine !== turn) return { cancelled: true };
    share = (at + block.length) / blob.size;
    rows = call("feed", block);
    if (settings.purpose === "capture") drain(pieces);
    const now = performance.now();
    if (now - said > 100) {
      postMessage({ id, progress: { done: at + block.length, total: blob.size, rows } });
      said = now;
      // Questions of the page are answered here.
      await new Promise((resume) => setTimeout(resume));
      if (mine !== turn) return { cancelled: true };
    }
    isCut = wasm.memory.buffer.byteLength > memoryLimit;
  }
  rows = call("finish");
  if (settings.purpose === "capture") drain(pieces);
  return { rows, isCut, megabytes: megabytes(), needed: needed(), pieces: pieces.length ? new Blob(pieces) : null };
}

function drain(pieces) {
  while (call("export_more")) pieces.push(output().slice());
}

// A line that is listened to: bytes of its raw recording come one after the other.
async function follow({ settings }) {
  turn++;
  await restart();
  call("open", encode({ ...settings, purpose: "live", format: "pcapng" }));
}

// A read of a port: what the core answers, and the bytes of the raw recording that it adds.
function read(question) {
  const answer = ask(question), pieces = [];
  drain(pieces);
  return { answer, pieces };
}

// Rows as a file, made in pieces.
async function save(question) {
  ask({ ...question, call: "export" });
  const pieces = [], mine = turn;
  while (call("export_more")) {
    pieces.push(output().slice());
    if (pieces.length % 64 === 0) await new Promise((resume) => setTimeout(resume));
    if (mine !== turn) throw new Error("another recording was opened");
  }
  return new Blob(pieces);
}

const CALLS = {
  start: async (id, request) => {
    module = request.module || module;
    memoryLimit = request.memoryLimit || memoryLimit;
    await restart();
    return ask({ call: "words" });
  },
  decode,
  ask: async (id, request) => ask(request.question),
  save: async (id, request) => save(request.question),
  follow: async (id, request) => follow(request),
  feed: async (id, request) => call("feed", request.bytes),
  read: async (id, request) => read(request.question),
  end: async () => call("finish"),
  cancel: async () => { turn++; },
};

onmessage = async ({ data }) => {
  try {
    postMessage({ id: data.id, value: await CALLS[data.call](data.id, data) });
  } catch (error) {
    postMessage({ id: data.id, error: String(error.message || error) });
  }
};
