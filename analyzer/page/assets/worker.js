// The worker: owns the core (WebAssembly), reads the recording in pieces, answers the page between two of them.
"use strict";
// A piece is decoded at a time, several are read at a time: each read is a message to another process.
const PIECE = 1 << 20, READ = 8 << 20, GIGABYTE = 1 << 30;
let wasm = null, module = null, turn = 0, memoryLimit = GIGABYTE;
// The share of the recording that has been read.
let share = 1;

const encode = (value) => new TextEncoder().encode(JSON.stringify(value));

// The module stays, an instance is made for each recording: memory of WebAssembly never shrinks.
const instance = async () => (await WebAssembly.instantiate(module, {})).exports;

async function restart() {
  wasm = await instance();
  share = 1;
}

// Calls the core. Views of its memory are dead after every call, so they are made when they are needed.
function call(name, bytes, core = wasm) {
  const at = core.input(bytes ? bytes.length : 0);
  if (bytes) new Uint8Array(core.memory.buffer, at, bytes.length).set(bytes);
  let found;
  try {
    found = core[name]();
  } catch (trap) {
    const text = new Uint8Array(core.memory.buffer, core.panic_text(), core.panic_length());
    const message = new TextDecoder().decode(text) || String(trap.message);
    throw new Error(/alloc|memory/i.test(message) ? `too big for this tab: ${needed()} MB needed` : `the decoder failed: ${message}`);
  }
  if (found < 0) throw new Error(JSON.parse(new TextDecoder().decode(output(core))).error);
  return found;
}

const output = (core = wasm) => new Uint8Array(core.memory.buffer, core.output(), core.output_length());
const megabytes = () => Math.round(wasm.memory.buffer.byteLength / 1048576);
// What the whole recording would take, by what its part has taken.
const needed = () => Math.ceil(megabytes() / share);

function ask(question) {
  call("ask", encode(question));
  return JSON.parse(new TextDecoder().decode(output()));
}

// The pieces of a recording; while one is decoded, the next ones are read.
async function* piecesOf(blob) {
  const read = (at) => blob.slice(at, at + READ).arrayBuffer();
  let next = read(0);
  for (let at = 0; at < blob.size; at += READ) {
    const bytes = new Uint8Array(await next);
    if (at + READ < blob.size) next = read(at + READ);
    for (let from = 0; from < bytes.length; from += PIECE) yield bytes.subarray(from, from + PIECE);
  }
}

// Decodes a recording; `progress` messages say how far it is. A later call of `decode` or `cancel` ends it. A capture is written
// beside the recording that is shown. Where rows take too much memory, the newest are kept, and `needed` says how much all take.
async function decode(id, { blob, settings }) {
  const mine = ++turn, isCapture = settings.purpose === "capture", pieces = [];
  if (!isCapture) await restart();
  const core = isCapture ? await instance() : wasm;
  call("open", encode(settings), core);
  let said = 0, rows = 0, done = 0, all = null;
  for await (const piece of piecesOf(blob)) {
    if (mine !== turn) return { cancelled: true };
    done += piece.length;
    if (!isCapture) share = done / blob.size;
    rows = call("feed", piece, core);
    if (isCapture) drain(pieces, core);
    const now = performance.now();
    if (now - said > 100) {
      postMessage({ id, progress: { done, total: blob.size, rows } });
      said = now;
      // Questions of the page are answered here.
      await new Promise((resume) => setTimeout(resume));
      if (mine !== turn) return { cancelled: true };
    }
    if (all === null && !isCapture && core.memory.buffer.byteLength > memoryLimit) {
      all = needed();
      ask({ call: "keep_newest" });
    }
  }
  rows = call("finish", null, core);
  if (isCapture) drain(pieces, core);
  return { rows, megabytes: megabytes(), needed: all, pieces: pieces.length ? new Blob(pieces) : null };
}

function drain(pieces, core = wasm) {
  while (call("export_more", null, core)) pieces.push(output(core).slice());
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
