// The tables of a recording: a tab for each, their columns, the rows of a filter, and the row that is looked at.
const Tables = (() => {
  const $ = (id) => document.getElementById(id);
  const el = Show.el, { ask } = Core;
  let statistics = null, grid = null, table = "transactions", hasFrames = true;

  const COLUMNS = {
    transactions: "txn elapsed_us bus client unit status response_time_us function_name address quantity data write_address write_data findings",
    frames: "frame elapsed_us bus unit function_name direction verdict confidence hex findings",
    findings: "elapsed_us txn frame bus unit code severity detail",
    connections: "connection client server requests answered refused reset in_flight_max findings",
  };
  // In characters; what is left of the width is shared out in these proportions.
  const WIDTHS = { txn: 10, bus: 14, client: 15, server: 21, unit: 4, address: 7, quantity: 4, function_name: 25, data: 24, write_address: 13, write_data: 12, response_time_us: 15, status: 12, findings: 20, hex: 50, detail: 60, code: 20, elapsed_us: 12, direction: 9 };

  // A time as it is read: since the start in seconds, others in milliseconds.
  const timeUnit = (key) => (key === "elapsed_us" ? "s" : "ms");
  const timeText = (key, text) => text && (key === "elapsed_us" ? Show.fixed(Number(text) / 1e6, 6) : Show.fixed(Number(text) / 1000, 3));

  function columnsOf(name) {
    const buses = statistics.buses.length, ofNetwork = statistics.buses.some((bus) => bus.mode === "tcp" || /:\d+$/.test(bus.bus));
    const known = Object.fromEntries(Core.words.columns[name].map((one) => [one.key, one]));
    return COLUMNS[name].split(" ").filter((key) => key in known && (buses > 1 || key !== "bus") && (ofNetwork || key !== "client" || name === "connections")).map((key) => {
      const { title, type, help } = known[key];
      const isDuration = type === "us";
      // Two more, for what is left free on both sides.
      const width = (WIDTHS[key] || 9) + 2;
      return {
        key, title: isDuration ? `${title} ${timeUnit(key)}` : title, help: Here.text(help),
        least: width, width: `minmax(${width}ch, ${width}fr)`, right: ["int", "us", "float"].includes(type),
        show: isDuration ? (text) => timeText(key, text) : null,
        mark: key === "status" || key === "verdict" || key === "severity" ? (text) => [`is-${text}`] : null,
      };
    });
  }

  const capital = (word) => word[0].toUpperCase() + word.slice(1);

  // How many rows a table has.
  const count = async (name) => (await ask({ call: "rows", table: name, columns: [], where: null, from: 0, count: 0 })).total;

  // One tab a table, with the number of its rows.
  async function showTabs() {
    for (const name of Object.keys(COLUMNS)) {
      if (name === "frames" && !hasFrames) {
        $("tab-frames")?.remove();
        continue;
      }
      const total = await count(name);
      if (!$(`tab-${name}`)) $("tabs").append(el("button", { role: "tab", id: `tab-${name}`, "data-table": name, "aria-controls": "table" }));
      $(`tab-${name}`).textContent = `${capital(name)} (${Show.fixed(total, 0)})`;
      $(`tab-${name}`).hidden = !total && name === "connections";
    }
    if (!$("tab-registers")) $("tabs").append(el("button", { role: "tab", id: "tab-registers", "data-table": "registers", "aria-controls": "table" }, "Registers"));
  }

  // Shows the tables of a recording with these statistics; `notes` say what is not in them.
  async function show(found, framed, notes) {
    statistics = found;
    hasFrames = framed;
    await showTabs();
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
    if (isMap) await Registers.load();
    else {
      await Filters.check(table, ask);
      Filters.fill(table, statistics);
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
      await Registers.detail(at, $("detail"));
      document.documentElement.dataset.detail = String(at);
      return;
    }
    const row = await ask({ call: "row", table, ...Filters.of(table), at });
    if (!row) return;
    const frames = await ask({ call: "bytes", table, ...Filters.of(table), at });
    const known = Core.words.columns[table].filter((one) => row[one.key]);
    const text = ({ key, type }) => (type === "hex" ? Bytes.spaced(row[key]) : type === "us" ? `${timeText(key, row[key])} ${timeUnit(key)}` : row[key]);
    const list = known.map((one) => el("div", {}, el("dt", { title: Here.text(one.help) }, one.title), el("dd", { class: one.type === "hex" ? "hex" : "" }, Show.visible(text(one)))));
    const codes = (row.findings || row.code || "").split(/[\s,;|\[\]"]+/).filter((code) => Core.words.findings[code]);
    const meaning = codes.flatMap((code) => {
      const { title, why, advice } = Core.words.findings[code];
      return [el("h3", {}, title), el("p", {}, why), el("p", {}, el("strong", {}, "Check: "), Here.text(advice))];
    });
    $("detail").replaceChildren(el("h2", {}, `${capital(table.slice(0, -1))} ${row.txn || row.frame || row.connection || at + 1}`), ...meaning,
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

  // Shows the rows that have come since; who was at the end stays there.
  async function update(found) {
    statistics = found;
    await showTabs();
    if (table === "registers") await Registers.load();
    const { total } = await grid.fetch(0, 0);
    $("shown").textContent = `${Show.fixed(total, 0)} rows`;
    const isAtEnd = grid.first >= grid.lastFirst;
    await grid.show(total, isAtEnd ? total : grid.first);
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

  $("tabs").addEventListener("click", (event) => { if (event.target.dataset.table) choose(event.target.dataset.table); });
  $("tabs").addEventListener("keydown", turnTabs);
  for (const id of ["unit", "failed", "finding"]) $(id).addEventListener("change", refresh);
  $("where").addEventListener("change", async () => { await Filters.check(table, ask); await refresh(); });

  return { show, update, count, showTransaction, get chosen() { return { table, ...Filters.of(table) }; } };
})();
