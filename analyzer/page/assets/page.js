// The page: takes recordings, has them decoded, shows the report and the tables, and saves what is shown.
const Page = (() => {
  const SMALL = 24 << 20, DOCUMENT_VERSION = 1;
  const $ = (id) => document.getElementById(id);
  const { el, say } = Show, { ask, request, cancel } = Core;
  let recordings = [], recording = null, data = null;

  // ---- recordings

  async function take(files) {
    await Serial.stop();
    const before = recordings;
    recordings = [];
    const troubles = [];
    let profiles = 0;
    await ready;
    for (const file of files) {
      try {
        if (await Registers.take(file)) profiles++;
        else recordings.push(...await Unpack.recordings(file.name, file));
      } catch (error) {
        troubles.push(error.message);
      }
    }
    // Profiles alone are for what is shown already, or comes next.
    if (profiles && !recordings.length) recordings = before;
    if (Registers.profiles.length) $("profiles").textContent = `Registers are named by ${Registers.profiles.map((one) => Show.visible(one.name)).join(", ")}.`;
    if (troubles.length) refuse(troubles.join("; "));
    $("which").replaceChildren(...recordings.map((one, at) => el("option", { value: String(at) }, Show.visible(one.name))));
    $("which-label").hidden = recordings.length < 2;
    if (recordings.length && !(troubles.length && recordings === before)) await open(recordings === before && recording?.blob ? recording : recordings[0]);
  }

  function refuse(why) {
    document.documentElement.dataset.state = "refused";
    if ($("progress")) $("progress").hidden = true;
    $("trouble").hidden = false;
    $("trouble").textContent = Show.visible(Here.text(why));
  }

  const settings = () => ({
    name: recording.name, format: $("format").value.trim(), mode: $("mode").value, line: $("line").value.trim(),
    profiles: Registers.profiles,
    ports: $("ports").value.trim() ? $("ports").value.split(/[\s,]+/).map(Number).filter((one) => one > 0 && one < 65536) : undefined,
  });

  async function decode(purpose, title) {
    const found = await request("decode", { blob: recording.blob, settings: { ...settings(), purpose } }, ({ done, total, rows }) => {
      $("bar").value = done / total;
      $("done").textContent = `${title}: ${Math.floor((100 * done) / total)} %, ${Show.fixed(rows, 0)} transactions`;
    });
    if (found.cancelled) throw new Error("cancelled");
    return found;
  }

  async function open(one) {
    recording = one;
    document.documentElement.dataset.state = "decoding";
    document.body.classList.add("opened");
    $("trouble").hidden = $("welcome").hidden = true;
    $("another").hidden = $("progress").hidden = false;
    $("results").hidden = true;
    Report.clear();
    try {
      if (await isDocument(one.blob)) return await showDocument(one);
      const began = performance.now();
      const hasFrames = one.blob.size <= SMALL;
      const found = await decode(hasFrames ? "all" : "large", "decoding");
      const made = await ask({ call: "report" });
      data = made.document;
      const rest = Report.verdict(made, true);
      await Tables.show(data.statistics, hasFrames, await notesOf(found, hasFrames));
      $("progress").hidden = true;
      const seconds = (performance.now() - began) / 1000;
      say(`${one.name}: ${Show.fixed(found.rows, 0)} transactions in ${Show.fixed(seconds, 1)} s. Nothing left this computer.`);
      document.documentElement.dataset.state = "shown";
      await Report.rest(rest);
    } catch (error) {
      if (error.message !== "cancelled") return refuse(`${one.name}: ${error.message}`);
      refuse(`${one.name}: cancelled`);
    }
  }

  // ---- what is shown

  // A document of modlens stats --to json, which is shown as a report.
  async function showDocument(one) {
    const found = JSON.parse(await one.blob.text());
    if (found.version !== DOCUMENT_VERSION) throw new Error(`this page reads version ${DOCUMENT_VERSION} of the document, not ${found.version}`);
    const made = await ask({ call: "report", document: found });
    data = made.document;
    const rest = Report.verdict(made, false);
    $("progress").hidden = true;
    say(`${one.name} is shown.`);
    document.documentElement.dataset.state = "shown";
    await Report.rest(rest);
  }

  const isDocument = async (blob) => /^\s*\{\s*"format":\s*"modlens report"/.test(await blob.slice(0, 1000).text());

  // What the tables do not have of a recording.
  async function notesOf(found, hasFrames) {
    const notes = [], kept = async (table) => Show.fixed(await Tables.count(table), 0);
    if (!hasFrames) notes.push(`Frames are listed of recordings up to ${SMALL >> 20} MB.`);
    if (!found.needed) return notes;
    const gone = await ask({ call: "forgotten" });
    if (gone.transactions) notes.push(`The last ${await kept("transactions")} of ${Show.fixed(found.rows, 0)} transactions are listed, and registers as they were in these: all are too big for this tab, about ${Show.fixed(found.needed, 0)} MB needed.`);
    if (gone.findings) notes.push(`Of ${Show.fixed(gone.findings, 0)} earlier findings only the numbers are kept; the last ${await kept("findings")} are listed.`);
    return [...notes, "Causes and statistics are those of the whole recording."];
  }

  // ---- a line that is listened to

  // Begins; `bytes` of what `live` says grow with what came.
  async function follow(live, known) {
    recording = live;
    data = null;
    Report.clear();
    document.documentElement.dataset.state = "waiting";
    document.body.classList.add("opened");
    $("trouble").hidden = true;
    await request("follow", { settings: { name: live.name, profiles: Registers.profiles, ...known } });
  }

  // Shows what has come: rows, and with `all` the causes and the report.
  async function showLive(all) {
    const isFirst = data === null;
    let rest = [];
    if (isFirst || all) {
      const made = await ask({ call: "report" });
      if (!made.document.statistics.buses.length) return;
      data = made.document;
      rest = Report.verdict(made, true);
    }
    if (isFirst) await Tables.show(data.statistics, true, []);
    else await Tables.update(data.statistics);
    document.documentElement.dataset.state = "live";
    await Report.rest(rest);
  }

  // ---- exports

  function saveAs(name, blob) {
    const link = el("a", { href: URL.createObjectURL(blob), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
    document.documentElement.dataset.saved = `${name} ${blob.size}`;
    say(`${name}: ${Show.fixed(blob.size, 0)} bytes`);
  }

  const NAMES = { pcapng: "modlens", html: "report" };

  async function save(format) {
    try {
      const { chosen } = Tables;
      say(`making ${format}…`);
      const blob = format === "pcapng" ? await capture() : format === "html" ? await Report.file() : await request("save", { question: { ...chosen, format } });
      const name = `${recording.name.replace(/^.*[/\\]/, "").replace(/\.[^.]*$/, "")}-${NAMES[format] || chosen.table}.${format}`;
      saveAs(name, blob);
    } catch (error) {
      say(error.message);
    }
  }

  // A capture has all frames: the recording is decoded once more, beside the rows that are shown.
  const capture = async () => (await decode("capture", "writing a capture")).pieces;

  // ---- hands

  // Files that are dropped, pasted or chosen.
  function takeFiles() {
    const body = document.body;
    body.addEventListener("dragover", (event) => { event.preventDefault(); body.classList.add("dropping"); });
    body.addEventListener("dragleave", () => body.classList.remove("dropping"));
    body.addEventListener("drop", (event) => {
      event.preventDefault();
      body.classList.remove("dropping");
      if (event.dataTransfer.files.length) take([...event.dataTransfer.files]);
    });
    document.addEventListener("paste", (event) => {
      if (/^(INPUT|TEXTAREA)$/.test(event.target.tagName)) return;
      const text = event.clipboardData.getData("text");
      const files = [...event.clipboardData.files];
      if (files.length) take(files);
      else if (text) take([new File([text], "pasted text")]);
    });
    $("file").addEventListener("change", ({ target }) => {
      const files = [...target.files];
      // So that the same file can be chosen again.
      target.value = "";
      if (files.length) take(files);
    });
    $("another").addEventListener("click", () => {
      $("welcome").hidden = false;
      $("file").focus();
    });
    $("decode-text").addEventListener("click", () => { if ($("text").value.trim()) take([new File([$("text").value], "pasted text")]); });
    $("which").addEventListener("change", () => open(recordings[Number($("which").value)]));
    $("again").addEventListener("click", () => { if (recording?.blob) open(recording); });
    $("cancel").addEventListener("click", cancel);
  }

  function listen() {
    for (const format of ["csv", "jsonl", "pcapng", "html"]) $(`save-${format}`).addEventListener("click", () => save(format));
    let waiting = 0;
    window.addEventListener("resize", () => { clearTimeout(waiting); waiting = setTimeout(() => data && Plots.resize(false), 100); });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => data && Plots.redraw());
    // The examples of a cause are rows of the table.
    $("verdict").addEventListener("click", (event) => {
      const link = event.target.closest("a[href^='#txn-']");
      if (!link || $("rows").hidden) return;
      event.preventDefault();
      Tables.showTransaction(link.hash.slice(5));
    });
  }

  document.body.classList.add("scripted");
  if ($("welcome")) takeFiles();
  listen();
  const ready = Core.start().then(() => {
    $("version").textContent = `modlens ${Core.words.version}`;
    document.documentElement.dataset.state = "ready";
  });
  ready.catch((error) => refuse(`This browser cannot run the decoder: ${error.message}`));
  // Tests ask the core by the same way as the page.
  return { ask, take, request, ready, follow, showLive, refuse, saveAs, get recording() { return recording; } };
})();
// Drivers of Firefox see what belongs to the window only.
window.Page = Page;
