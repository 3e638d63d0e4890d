// A line while it is listened to: a tap sends its raw recording, or a port of this computer is read.
const Live = (() => {
  const ROWS_MS = 700, REPORT_MS = 5000, KEPT = 256 << 20;
  const $ = (id) => document.getElementById(id);
  const say = (text) => { $("state").textContent = Show.visible(text); };
  // What came, for saving; its first part where that is too much.
  let pieces = [], kept = 0, isFull = false, isPaused = false, live = null;

  function keep(bytes) {
    isFull ||= kept + bytes.length > KEPT;
    if (isFull) return;
    pieces.push(bytes);
    kept += bytes.length;
  }

  // Draws while `isOn` says so: rows often, the report seldom.
  async function draw(isOn) {
    let before = -Infinity;
    while (isOn()) {
      await new Promise((resume) => setTimeout(resume, ROWS_MS));
      if (isPaused || document.hidden) continue;
      const all = performance.now() - before > REPORT_MS;
      await Page.showLive(all);
      if (all) before = performance.now();
    }
  }

  async function begin(name, known) {
    pieces = [];
    kept = 0;
    isFull = false;
    live = { name, bytes: 0 };
    $("live").hidden = false;
    await Page.follow(live, known);
  }

  // Follows the stream of a tap. Bytes are asked for when those before are decoded: a slow page never makes the tap wait.
  async function fromTap() {
    await Page.ready;
    await begin("line", {});
    const answer = await fetch(`recording.pcapng${location.search}`);
    if (!answer.ok) throw new Error(answer.status === 503 ? "the tap serves as many pages as it can" : `the tap answers ${answer.status}`);
    const reader = answer.body.getReader();
    let isOn = true;
    const drawn = draw(() => isOn).catch((error) => say(error.message));
    say("Listening…");
    try {
      for (;;) {
        const { done, value } = await reader.read();
        if (done) break;
        keep(value);
        live.bytes += value.length;
        await Page.request("feed", { bytes: value });
      }
    } finally {
      isOn = false;
      await drawn;
    }
    await end("The tap has ended.");
  }

  async function end(why) {
    await Page.request("end");
    await Page.showLive(true);
    say(why);
    document.documentElement.dataset.state = "ended";
  }

  $("pause").addEventListener("click", () => {
    isPaused = !isPaused;
    $("pause").setAttribute("aria-pressed", String(isPaused));
    $("pause").textContent = isPaused ? "Go on" : "Pause";
  });
  $("save-recording").addEventListener("click", () => {
    if (isFull) say(`Only the first ${KEPT >> 20} MB are in the file.`);
    Page.saveAs("line.pcapng", new Blob(pieces));
  });
  if (document.getElementById("tapped")) fromTap().catch((error) => Page.refuse(`The connection to the tap has ended: ${error.message}`));

  return { begin, keep, draw, end, say, get live() { return live; }, get pieces() { return pieces; } };
})();
// Drivers of Firefox see what belongs to the window only.
window.Live = Live;
