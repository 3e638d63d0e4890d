// What a dropped file holds: itself, or the recordings in a gzip, zip or tar file; texts as UTF-8.
const Unpack = (() => {
  const MOST_MEMBERS = 1000, DEEPEST = 3, MOST_BYTES = 2 ** 31, SAMPLE = 65536;
  const OTHERS = [
    ["xz", [0xfd, 0x37, 0x7a, 0x58, 0x5a]], ["bzip2", [0x42, 0x5a, 0x68]], ["zstd", [0x28, 0xb5, 0x2f, 0xfd]],
    ["7z", [0x37, 0x7a, 0xbc, 0xaf]], ["rar", [0x52, 0x61, 0x72, 0x21]],
  ];

  const bytesOf = async (blob, from, to) => new Uint8Array(await blob.slice(from, to).arrayBuffer());
  const begins = (bytes, magic) => magic.every((one, at) => bytes[at] === one);
  const text = (bytes) => new TextDecoder().decode(bytes);

  // The bytes of a stream as a Blob; more than MOST_BYTES are refused.
  async function collect(stream) {
    const pieces = [], reader = stream.getReader();
    let size = 0;
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return new Blob(pieces);
      size += value.length;
      if (size > MOST_BYTES) throw new Error("unpacks to more than 2 GB; unpack it first, or use the command");
      pieces.push(value);
    }
  }

  const inflate = (blob, format) => collect(blob.stream().pipeThrough(new DecompressionStream(format)));

  // All recordings in a file, as { name, blob }.
  async function recordings(name, blob, depth = 0) {
    const head = await bytesOf(blob, 0, 512);
    if (depth > DEEPEST) throw new Error(`${name}: packed too deep; unpack it first`);
    const other = OTHERS.find(([, magic]) => begins(head, magic));
    if (other) throw new Error(`${name}: packed by ${other[0]}, which a browser cannot unpack; unpack it first`);
    if (begins(head, [0x1f, 0x8b, 8])) {
      try {
        return await recordings(name.replace(/\.t?gz$/i, ""), await inflate(blob, "gzip"), depth + 1);
      } catch (error) {
        // Raw bytes of a line may begin like that.
        if (depth || /unpack/.test(error.message)) throw error;
      }
    }
    if (begins(head, [0x50, 0x4b, 3, 4]) && !isSigrok(head)) return members(await zip(name, blob), depth);
    if (text(head.slice(257, 262)) === "ustar") return members(await tar(name, blob), depth);
    return [{ name, blob: await asUtf8(blob) }];
  }

  const isSigrok = (head) => ["version", "metadata"].some((name) => text(head.slice(30, 30 + name.length)) === name);

  async function members(found, depth) {
    const all = [];
    for (const one of found) all.push(...await recordings(one.name, one.blob, depth + 1));
    return all;
  }

  // The central directory stands at the end and has the true sizes.
  async function zip(name, blob) {
    const tailAt = Math.max(0, blob.size - 65557), tail = await bytesOf(blob, tailAt);
    let end = tail.length - 22;
    while (end >= 0 && !begins(tail.subarray(end), [0x50, 0x4b, 5, 6])) end--;
    if (end < 0) throw new Error(`${name}: a damaged zip file; its directory is missing`);
    const view = new DataView(tail.buffer), count = Math.min(view.getUint16(end + 10, true), MOST_MEMBERS);
    const directory = await bytesOf(blob, view.getUint32(end + 16, true), view.getUint32(end + 16, true) + view.getUint32(end + 12, true));
    const entries = new DataView(directory.buffer), found = [];
    for (let at = 0, n = 0; n < count && at + 46 <= directory.length; n++) {
      const [flags, method] = [entries.getUint16(at + 8, true), entries.getUint16(at + 10, true)];
      const [packed, nameLength] = [entries.getUint32(at + 20, true), entries.getUint16(at + 28, true)];
      const offset = entries.getUint32(at + 42, true), member = text(directory.slice(at + 46, at + 46 + nameLength));
      at += 46 + nameLength + entries.getUint16(at + 30, true) + entries.getUint16(at + 32, true);
      if (member.endsWith("/")) continue;
      if (flags & 1) throw new Error(`${member}: encrypted; unpack it first`);
      if (method !== 0 && method !== 8) throw new Error(`${member}: packed by a method that a browser cannot unpack; unpack it first`);
      const local = new DataView((await bytesOf(blob, offset, offset + 30)).buffer);
      const start = offset + 30 + local.getUint16(26, true) + local.getUint16(28, true);
      const data = blob.slice(start, start + packed);
      found.push({ name: member, blob: method ? await inflate(data, "deflate-raw") : data });
    }
    return found;
  }

  async function tar(name, blob) {
    const found = [];
    for (let at = 0; at + 512 <= blob.size && found.length < MOST_MEMBERS;) {
      const head = await bytesOf(blob, at, at + 512);
      if (head.every((one) => one === 0)) break;
      const size = parseInt(text(head.slice(124, 136)), 8);
      if (!(size >= 0)) throw new Error(`${name}: a damaged tar file`);
      const kind = head[156], member = text(head.slice(0, 100)).replace(/\0.*/s, "");
      if (kind === 0x30 || kind === 0) found.push({ name: member, blob: blob.slice(at + 512, at + 512 + size) });
      at += 512 + Math.ceil(size / 512) * 512;
    }
    return found;
  }

  // The rules of analyzer/sources/encodings.py.
  async function asUtf8(blob) {
    const sample = await bytesOf(blob, 0, SAMPLE), encoding = encodingOf(sample);
    return encoding ? new Blob([new TextDecoder(encoding).decode(await blob.arrayBuffer())]) : blob;
  }

  function encodingOf(sample) {
    if (begins(sample, [0xff, 0xfe]) && isPlain(sample, "utf-16le")) return "utf-16le";
    if (begins(sample, [0xfe, 0xff]) && isPlain(sample, "utf-16be")) return "utf-16be";
    for (const [name, first] of [["utf-16le", 1], ["utf-16be", 0]]) {
      const places = Math.floor(sample.length / 2);
      let zeros = 0;
      for (let at = first; at < sample.length; at += 2) zeros += sample[at] === 0;
      if (places >= 4 && zeros > 0.4 * places && isPlain(sample, name)) return name;
    }
    if (decodes(sample, "utf-8") || sample.some((one) => one < 32 && ![9, 10, 13, 12, 27].includes(one))) return null;
    if (sample.filter((one) => one >= 128).length * 2 > sample.length) return null;
    return decodes(sample, "gbk") ? "gbk" : "windows-1251";
  }

  function decodes(sample, encoding) {
    try {
      new TextDecoder(encoding, { fatal: true }).decode(sample, { stream: true });
      return true;
    } catch {
      return false;
    }
  }

  function isPlain(sample, encoding) {
    const letters = new TextDecoder(encoding).decode(sample.subarray(0, sample.length & ~1));
    let ascii = 0, controls = 0;
    for (const letter of letters) {
      const plain = letter >= " " && letter <= "~";
      ascii += plain || "\t\r\n".includes(letter);
      controls += letter < " " && !"\t\r\n\x1b".includes(letter);
    }
    return ascii > 0.4 * letters.length && controls <= 0.02 * letters.length;
  }

  return { recordings };
})();
