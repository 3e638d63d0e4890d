// The page: takes recordings, has the worker decode them, shows causes, tables, and the row that is looked at.
const Page = (() => {
  const SMALL = 24 << 20, DOCUMENT_VERSION = 1;
  const $ = (id) => document.getElementById(id);
  const el = Show.el;
  const worker = {};
  let words = null, recordings = [], recording = null, data = null, grid = null, table = "transactions", hasFrames = true;

  const { say } = Show;

  // ---- the worker

  async function start() {
    const text = $("wasm").content.textContent;
    $("wasm").remove();
    const packed = Uint8Array.fromBase64?.(text) ?? Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
    const bytes = await new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
    const module = await WebAssembly.compile(bytes);
    worker.port = new Worker(URL.createObjectURL(new Blob([$("worker").content.textContent], { type: "text/javascript" })));
    worker.waiting = new Map();
    worker.port.onmessage = ({ data: found }) => {
      const asked = worker.waiting.get(found.id);
      if (found.progress) return asked?.progress?.(found.progress);
      worker.waiting.delete(found.id);
      if ("error" in found) asked?.reject(new Error(found.error));
      else asked?.resolve(found.value);
    };
    const memoryLimit = navigator.deviceMemory && navigator.deviceMemory <= 4 ? 300 << 20 : 1 << 30;
    words = await request("start", { module, memoryLimit });
    $("version").textContent = `modlens ${words.version}`;
    document.documentElement.dataset.state = "ready";
  }

  let next = 0;
  function request(call, content = {}, progress = null) {
    return new Promise((resolve, reject) => {
      const id = ++next;
      worker.waiting.set(id, { resolve, reject, progress });
      worker.port.postMessage({ id, call, ...content });
    });
  }
  // Ends what is being decoded: the page goes on at once, the worker after the block that it is at.
  function cancel() {
    request("cancel");
    for (const [id, asked] of worker.waiting) {
      if (!asked.progress) continue;
      worker.waiting.delete(id);
      asked.resolve({ cancelled: true });
    }
  }

  const ask = (question) => request("ask", { question });

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
        if (await Registers.take(file, ask)) profiles++;
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
    $("trouble").textContent = Show.visible(why);
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
    try {
      if (await isDocument(one.blob)) return await showDocument(one);
      const began = performance.now();
      hasFrames = one.blob.size <= SMALL;
      const found = await decode(hasFrames ? "all" : "large", "decoding");
      const made = await ask({ call: "report" });
      data = made.document;
      const rest = Report.verdict(made, true);
      await showTables(found);
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

  const COLUMNS = {
    transactions: "txn elapsed_us bus client unit function_name address quantity data write_address write_data status response_time_us findings",
    frames: "frame elapsed_us bus unit function_name direction verdict confidence hex findings",
    findings: "elapsed_us txn frame bus unit code severity detail",
    connections: "connection client server requests answered refused reset in_flight_max findings",
  };
  // In characters; what is left of the width is shared out in these proportions.
  const WIDTHS = { bus: 14, client: 15, server: 21, unit: 4, address: 7, quantity: 4, function_name: 25, data: 24, write_data: 12, status: 12, findings: 20, hex: 50, detail: 60, code: 20, elapsed_us: 14, direction: 9 };

  // A time as it is read: since the start in seconds, others in milliseconds.
  const timeUnit = (key) => (key === "elapsed_us" ? "s" : "ms");
  const timeText = (key, text) => text && (key === "elapsed_us" ? Show.fixed(Number(text) / 1e6, 6) : Show.fixed(Number(text) / 1000, 3));

  function columnsOf(name) {
    const buses = data.statistics.buses.length, ofNetwork = data.statistics.buses.some((bus) => bus.mode === "tcp" || /:\d+$/.test(bus.bus));
    const known = Object.fromEntries(words.columns[name].map((one) => [one.key, one]));
    return COLUMNS[name].split(" ").filter((key) => key in known && (buses > 1 || key !== "bus") && (ofNetwork || key !== "client" || name === "connections")).map((key) => {
      const { title, type, help } = known[key];
      const isDuration = type === "us";
      // Two more, for what is left free on both sides.
      const width = (WIDTHS[key] || 9) + 2;
      return {
        key, title: isDuration ? `${title} ${timeUnit(key)}` : title, help,
        least: width, width: `minmax(${width}ch, ${width}fr)`, right: ["int", "us", "float"].includes(type),
        show: isDuration ? (text) => timeText(key, text) : null,
        mark: key === "status" || key === "verdict" || key === "severity" ? (text) => [`is-${text}`] : null,
      };
    });
  }

  const count = (name) => ask({ call: "rows", table: name, columns: [], where: null, from: 0, count: 0 });

  // One tab a table, with the number of its rows.
  async function showTabs() {
    for (const name of Object.keys(COLUMNS)) {
      if (name === "frames" && !hasFrames) {
        $("tab-frames")?.remove();
        continue;
      }
      const { total } = await count(name);
      if (!$(`tab-${name}`)) $("tabs").append(el("button", { role: "tab", id: `tab-${name}`, "data-table": name, "aria-controls": "table" }));
      $(`tab-${name}`).textContent = `${name[0].toUpperCase()}${name.slice(1)} (${Show.fixed(total, 0)})`;
      $(`tab-${name}`).hidden = !total && name === "connections";
    }
    if (!$("tab-registers")) $("tabs").append(el("button", { role: "tab", id: "tab-registers", "data-table": "registers", "aria-controls": "table" }, "Registers"));
  }

  async function showTables(found) {
    await showTabs();
    const notes = [], { total } = await count("transactions");
    if (!hasFrames) notes.push(`Frames are listed of recordings up to ${SMALL >> 20} MB.`);
    if (found.needed) notes.push(`The last ${Show.fixed(total, 0)} of ${Show.fixed(found.rows, 0)} transactions are listed, and registers as they were in these: all are too big for this tab, about ${Show.fixed(found.needed, 0)} MB needed. Causes, statistics and findings are those of all.`);
    $("limits").textContent = notes.join(" ");
    await choose("transactions");
  }

  async function choose(name) {
    table = name;
    const isMap = name === "registers";
    $("filters").hidden = isMap;
    for (const tab of $("tabs").children) {
      tab.setAttribute("aria-selected", String(tab.dataset.table === name));
      tab.tabIndex = tab.dataset.table === name ? 0 : -1;
    }
    if (isMap) await Registers.load(ask);
    else {
      await Filters.check(table, ask);
      Filters.fill(table, data.statistics);
    }
    const columns = isMap ? Registers.columns : columnsOf(name);
    grid = new Grid($("table"), {
      label: name, columns, open: (row) => detail(row),
      fetch: (from, count) => isMap ? Registers.part(from, count) : ask({ call: "rows", table: name, columns: columns.map((one) => one.key), ...Filters.of(table), from, count }),
    });
    Charts.forget($("detail"));
    $("detail").parentElement.classList.remove("chosen");
    await refresh();
  }

  // Shows the rows of the filter from the first one on.
  async function refresh() {
    const { total } = await grid.fetch(0, 0);
    $("shown").textContent = `${Show.fixed(total, 0)} rows`;
    grid.at = 0;
    await grid.show(total, 0);
  }

  // Makes room for what is shown of a row; the table may shrink, and its chosen row stays in view.
  async function makeRoom() {
    $("detail").parentElement.classList.add("chosen");
    await grid.reveal();
  }

  // A row: all its columns that have a value, its bytes, and what its findings mean.
  async function detail(at) {
    Charts.forget($("detail"));
    if (table === "registers") {
      await makeRoom();
      await Registers.detail(at, $("detail"), ask);
      document.documentElement.dataset.detail = String(at);
      return;
    }
    const row = await ask({ call: "row", table, ...Filters.of(table), at });
    if (!row) return;
    const frames = await ask({ call: "bytes", table, ...Filters.of(table), at });
    const known = words.columns[table].filter((one) => row[one.key]);
    const text = ({ key, type }) => (type === "hex" ? Bytes.spaced(row[key]) : type === "us" ? `${timeText(key, row[key])} ${timeUnit(key)}` : row[key]);
    const list = known.map((one) => el("div", {}, el("dt", { title: one.help }, one.title), el("dd", { class: one.type === "hex" ? "hex" : "" }, Show.visible(text(one)))));
    const codes = (row.findings || row.code || "").split(/[\s,;|\[\]"]+/).filter((code) => words.findings[code]);
    const meaning = codes.flatMap((code) => {
      const { title, why, advice } = words.findings[code];
      return [el("h3", {}, title), el("p", {}, why), el("p", {}, el("strong", {}, "Check: "), advice)];
    });
    $("detail").replaceChildren(el("h2", {}, `${table.slice(0, -1)} ${row.txn || row.frame || row.connection || at + 1}`), ...meaning,
      ...frames.flatMap(Bytes.table), el("dl", {}, ...list));
    await makeRoom();
    $("detail").scrollIntoView({ block: "nearest" });
    document.documentElement.dataset.detail = String(at);
  }

  // Shows a transaction in the table of all.
  async function showTransaction(number) {
    Filters.clear();
    await choose("transactions");
    const { at } = await ask({ call: "find", table, where: null, column: "txn", value: number });
    $("rows").scrollIntoView();
    if (at === null) return;
    grid.root.focus({ preventScroll: true });
    await grid.choose(at, true);
  }

  // ---- a line that is listened to

  // Begins; `bytes` of what `live` says grow with what came.
  async function follow(live, known) {
    recording = live;
    hasFrames = true;
    data = null;
    document.documentElement.dataset.state = "waiting";
    document.body.classList.add("opened");
    $("trouble").hidden = true;
    await request("follow", { settings: { name: live.name, ...known } });
  }

  // Shows what has come: rows, and with `all` the causes and the report.
  async function showLive(all) {
    const isFirst = data === null;
    if (isFirst || all) {
      const made = await ask({ call: "report" });
      if (!made.document.statistics.buses.length) return;
      data = made.document;
      Report.replace(Report.verdict(made, true));
    }
    if (isFirst) {
      await showTables({});
      document.documentElement.dataset.state = "live";
      return;
    }
    await showTabs();
    if (table === "registers") await Registers.load(ask);
    const { total } = await grid.fetch(0, 0);
    $("shown").textContent = `${Show.fixed(total, 0)} rows`;
    const isAtEnd = grid.first >= grid.lastFirst;
    await grid.show(total, isAtEnd ? total : grid.first);
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
      say(`making ${format}…`);
      const blob = format === "pcapng" ? await capture() : format === "html" ? await Report.file() : await request("save", { question: { table, ...Filters.of(table), format } });
      const name = `${recording.name.replace(/^.*[/\\]/, "").replace(/\.[^.]*$/, "")}-${NAMES[format] || table}.${format}`;
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

  // Arrows go from tab to tab, round and round.
  function turnTabs(event) {
    const tabs = [...$("tabs").children].filter((one) => !one.hidden), at = tabs.indexOf(event.target);
    const next = { ArrowLeft: at - 1, ArrowRight: at + 1, Home: 0, End: -1 }[event.key];
    if (next === undefined || at < 0) return;
    event.preventDefault();
    const tab = tabs.at(next % tabs.length);
    tab.focus();
    choose(tab.dataset.table);
  }

  function listen() {
    $("tabs").addEventListener("click", (event) => { if (event.target.dataset.table) choose(event.target.dataset.table); });
    $("tabs").addEventListener("keydown", turnTabs);
    for (const id of ["unit", "failed", "finding"]) $(id).addEventListener("change", refresh);
    $("where").addEventListener("change", async () => { await Filters.check(table, ask); await refresh(); });
    for (const format of ["csv", "jsonl", "pcapng", "html"]) $(`save-${format}`).addEventListener("click", () => save(format));
    let waiting = 0;
    window.addEventListener("resize", () => { clearTimeout(waiting); waiting = setTimeout(() => data && Plots.resize(false), 100); });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => data && Plots.redraw());
    // The examples of a cause are rows of the table.
    $("verdict").addEventListener("click", (event) => {
      const link = event.target.closest("a[href^='#txn-']");
      if (!link || $("rows").hidden) return;
      event.preventDefault();
      showTransaction(link.hash.slice(5));
    });
  }

  document.body.classList.add("scripted");
  if ($("welcome")) takeFiles();
  listen();
  const ready = start();
  ready.catch((error) => refuse(`This browser cannot run the decoder: ${error.message}`));
  // Tests ask the core by the same way as the page.
  return { ask, take, request, ready, follow, showLive, refuse, saveAs, get recording() { return recording; } };
})();
// Drivers of Firefox see what belongs to the window only.
window.Page = Page;
