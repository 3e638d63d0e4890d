// A port of this computer that is listened to by Web Serial. It is opened, read and closed; nothing is ever written to it.
const Serial = (() => {
  // Chromium keeps 255 bytes unless told otherwise, and the page may be busy for longer.
  const BUFFER = 1 << 20, TICK_MS = 500;
  const PARITIES = { N: "none", E: "even", O: "odd" };
  // Firefox takes damaged bytes out, or puts 00 in their place, and reports nothing.
  const isSilent = /Firefox/.test(navigator.userAgent);
  const $ = (id) => document.getElementById(id);

  // When it is, in ns since 1970.
  const now = () => String(BigInt(Math.round((performance.timeOrigin + performance.now()) * 1000)) * 1000n);
  const hex = (bytes) => Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");

  // What a browser opens a port with; it knows fewer settings than lines have.
  function settingsOf(line) {
    const [, baud, data, parity, stop] = /^(\d+)-(\d)([A-Z])([\d.]+)$/.exec(line);
    if (!PARITIES[parity] || data < 7 || !["1", "2"].includes(stop)) throw new Error(`no browser listens at ${line}`);
    return { baudRate: Number(baud), dataBits: Number(data), parity: PARITIES[parity], stopBits: Number(stop), bufferSize: BUFFER };
  }

  class Listener {
    constructor(port) {
      this.port = port;
      this.isOn = true;
      this.hasHole = false;
      this.errors = {};
    }

    // Takes an answer of the core: what it says, and the settings that it asks for.
    take({ answer, pieces }) {
      pieces.forEach(Live.keep);
      if (answer.said.length) $("serial-said").textContent = Here.text(answer.said.at(-1));
      this.isSearching = answer.searching;
      if (answer.line === this.line) return;
      this.line = answer.line;
      this.reader?.cancel().catch(() => {});
    }

    // Tells the core of a read. Reads are told in their order, nobody waits for the answer.
    tell(content) {
      const question = { call: "read", time: now(), ...content };
      return Page.request("read", { question }).then((found) => this.take(found)).catch((error) => this.fail(error));
    }

    fail(error) {
      this.trouble = this.trouble || error.message;
      this.isOn = false;
      this.reader?.cancel().catch(() => {});
    }

    async run() {
      while (this.isOn) {
        const line = this.line;
        await this.port.open(settingsOf(line));
        // Systems raise both when a port is opened; adapters may drive the line as long as one of them is.
        await this.port.setSignals({ dataTerminalReady: false, requestToSend: false }).catch(() => {});
        if (this.isSearching) this.tell({ is_set: true });
        while (this.isOn && this.port.readable && line === this.line) await this.read(line);
        const isGone = !this.port.readable;
        await this.port.close().catch(() => {});
        if (isGone) throw new Error("the port is gone");
      }
    }

    // Reads until the stream ends, which each error makes it do; the next stream goes on.
    async read(line) {
      this.reader = this.port.readable.getReader();
      try {
        while (this.isOn && line === this.line) {
          const { value, done } = await this.reader.read();
          const time = now();
          if (done) break;
          this.tell({ hex: hex(value), time, hole: this.hasHole });
          this.hasHole = false;
          this.count(value.length);
        }
      } catch (error) {
        if (error.name === "NetworkError") throw new Error("the port is gone");
        // The bytes concerned are taken out by the browser, which does not say where they were.
        this.hasHole = true;
        this.errors[error.name] = (this.errors[error.name] || 0) + 1;
        this.say();
      } finally {
        this.reader.releaseLock();
        this.reader = null;
      }
    }

    count(bytes) {
      Live.live.bytes += bytes;
      this.say();
    }

    say() {
      const errors = Object.entries(this.errors).map(([name, count]) => `, ${count} ${name}`).join("");
      Live.say(`${this.isSearching ? "Trying" : "Listening at"} ${this.line}: ${Show.fixed(Live.live.bytes, 0)} bytes${errors}`);
    }

    async end() {
      this.isOn = false;
      await this.reader?.cancel().catch(() => {});
    }
  }

  let listener = null;

  // Begins; the browser asks which port. Ends when `stop` says so, or the port is gone.
  async function listen() {
    const line = $("serial-line").value.trim();
    if (isSilent && !line) return Page.refuse("This browser cannot search the settings: write them, for example 19200-8E1.");
    let port;
    try {
      port = await navigator.serial.requestPort();
    } catch (error) {
      return Page.refuse(error.name === "NotFoundError" ? "No port was chosen." : `This browser gives no port: ${error.message}`);
    }
    const mine = new Listener(port);
    listener = mine;
    let drawn = null;
    try {
      await Live.begin("port", { mode: $("mode").value });
      mine.take(await Page.request("read", { question: { call: "listen", name: "port", line } }));
      $("stop").hidden = false;
      $("welcome").hidden = true;
      $("another").hidden = false;
      mine.say();
      drawn = Live.draw(() => mine.isOn).catch((error) => Live.say(error.message));
      const ticks = setInterval(() => mine.tell({}), TICK_MS);
      await mine.run().catch((error) => mine.fail(error)).finally(() => clearInterval(ticks));
      mine.take(await Page.request("read", { question: { call: "hang_up", time: now() } }));
      await drawn;
      await Live.end(mine.trouble ? `Ended: ${mine.trouble}.` : "Stopped.");
    } catch (error) {
      mine.isOn = false;
      Page.refuse(mine.trouble || error.message);
    } finally {
      $("stop").hidden = true;
      listener = null;
    }
  }

  // Ends what is being listened to, and waits for it.
  async function stop() {
    await listener?.end();
    while (listener) await new Promise((resume) => setTimeout(resume, 20));
  }

  if ($("serial") && navigator.serial) {
    $("serial").hidden = false;
    $(isSilent ? "serial-silent" : "serial-search").hidden = false;
    $("listen").addEventListener("click", listen);
    $("stop").addEventListener("click", stop);
  }

  return { stop };
})();
