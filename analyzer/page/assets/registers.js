// The registers of a recording: profiles that name them, the last value of each, and how one of them went.
const Registers = (() => {
  const { el } = Show, { ask } = Core, STEPS = 800;
  const FORMS = { toml: "toml", yaml: "yaml", yml: "yaml", csv: "csv" };
  let profiles = [], rows = [];

  const SMALL = 0.001, LARGE = 1e15;
  const figure = (value) => {
    if (value === null) return "";
    const size = Math.abs(value);
    return size && (size < SMALL || size >= LARGE) ? value.toExponential(3) : value.toLocaleString("en-US", { maximumFractionDigits: 4, useGrouping: false });
  };
  // As profiles write it: hr:107.
  const place = (row) => `${Core.words.register_types[row.register_type]}:${row.address}`;
  // Title, share of the width, text, on the right; name and value fit a phone beside their register.
  const COLUMNS = [
    ["unit", 4, (row) => String(row.unit), true],
    ["register", 9, place],
    ["name", 26, (row) => row.name || ""],
    ["value", 18, (row) => `${row.value_text ?? figure(row.value)} ${row.unit_of_measure || ""}`.trim(), true],
    ["min", 9, (row) => figure(row.min), true],
    ["max", 9, (row) => figure(row.max), true],
    ["seen", 8, (row) => String(row.count), true],
    ["changes", 8, (row) => String(row.changes), true],
  ];
  const LEAST = 11;
  const columns = COLUMNS.map(([title, width, , right]) => {
    const least = Math.min(width, LEAST) + 2;
    return { key: title, title, least, width: `minmax(${least}ch, ${width + 2}fr)`, right: Boolean(right) };
  });

  // Takes a file, if it is a profile: one of a sheet is told from a log by what the core says of it.
  async function take(file) {
    const form = FORMS[file.name.toLowerCase().split(".").pop()];
    if (!form || file.size > 1 << 20) return false;
    const text = await file.text();
    try {
      await ask({ call: "profile", text, form });
    } catch (error) {
      if (form === "csv") return false;
      throw new Error(`${file.name}: ${error.message}`);
    }
    profiles = [...profiles.filter((one) => one.name !== file.name), { name: file.name, text, form }];
    return true;
  }

  async function load() {
    rows = await ask({ call: "map" });
    return rows.length;
  }

  const part = (from, count) => ({ total: rows.length, rows: rows.slice(from, from + count).map((row) => COLUMNS.map(([, , text]) => text(row))) });

  // The register of a row of the map: its values over time.
  async function detail(at, host) {
    const row = rows[at];
    if (!row) return;
    const title = `${row.name || place(row)} of unit ${row.unit}`;
    const where = `unit == ${row.unit} and register_type == '${row.register_type}' and address == ${row.address}`;
    const { total, steps } = await ask({ call: "series", table: "readings", where, most: STEPS });
    host.replaceChildren(el("h2", {}, Show.visible(title)), el("p", {}, `${Show.fixed(total, 0)} values, ${Show.fixed(row.changes, 0)} changes.`));
    if (steps.length < 2) return;
    const drawn = el("div", {});
    host.append(drawn);
    const x = steps.map(([time]) => time / 1e6), span = [x[0], x.at(-1)];
    const series = [{ name: "lowest", values: steps.map(([, low]) => low) }];
    if (steps.some(([, low, high]) => low !== high)) series.push({ name: "highest", values: steps.map(([, , high]) => high) });
    if (series.length === 1) series[0].name = "value";
    Charts.chart(drawn, { title: `${Show.visible(title)} over time`, unit: row.unit_of_measure || "value", x, span, scale: { time: false, range: () => span },
      xSeries: { label: "seconds", value: (_, value) => (value === null ? "" : `${Show.fixed(value, 3)} s`) }, label: "seconds from the start", series, fromZero: false });
  }

  return { take, load, part, detail, columns, get profiles() { return profiles; } };
})();
