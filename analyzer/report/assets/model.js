// What a report shows of a document: the words of model.py, for documents that are dropped on the page.
"use strict";
const Model = (() => {
  const ESCAPED = /[\u0000-\u001f\u007f-\u009f\u00ad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ud800-\udfff]|[\u{e0000}-\u{e007f}]/gu;
  const SHORT = { "\t": "\\t", "\n": "\\n", "\r": "\\r" };
  const VERDICTS = { healthy: "healthy", trouble: "trouble", broken: "broken", unknown: "not enough to judge" };
  const SEVERITIES = ["error", "warning", "info"];
  const FAILED = ["no_response", "bad_request", "bad_response"];

  function visible(text) {
    return text.replace(ESCAPED, (one) => {
      const code = one.codePointAt(0), hex = (digits) => code.toString(16).padStart(digits, "0");
      return SHORT[one] || (code < 256 ? "\\x" + hex(2) : code < 65536 ? "\\u" + hex(4) : "\\U" + hex(8));
    });
  }

  function fixed(value, decimals, group = true) {
    const scale = 10 ** decimals, scaled = Math.floor(Math.abs(value) * scale + 0.5);
    const whole = Math.floor(scaled / scale), rest = scaled - whole * scale;
    let text = group ? String(whole).replace(/\B(?=(\d{3})+$)/g, ",") : String(whole);
    if (decimals) text += "." + String(rest).padStart(decimals, "0");
    return value < 0 && scaled ? "-" + text : text;
  }

  function plain(value) {
    if (typeof value === "string") return visible(value);
    if (typeof value === "boolean") return value ? "True" : "False";
    if (!Number.isInteger(value)) return fixed(value, 6, false).replace(/0+$/, "").replace(/\.$/, "");
    return BigInt(value).toString();
  }

  // 100 % is said of all only.
  const percent = (share) => fixed(share < 1 ? Math.min(share * 100, 99.9) : share * 100, 1) + " %";

  const isNested = (value) => typeof value === "object" && value !== null;

  function rowsAt(document, path) {
    let found = [document];
    for (const part of path.split(".")) {
      const isList = part.endsWith("[]"), key = isList ? part.slice(0, -2) : part, deeper = [];
      for (const row of found) {
        const value = row[key], around = {};
        if (row !== document) for (const name in row) if (!isNested(row[name])) around[name] = row[name];
        const items = isList ? value || [] : value ? [value] : [];
        for (const item of items) deeper.push({ ...around, ...item });
      }
      found = deeper;
    }
    return found;
  }

  function valueAt(row, path) {
    let found = row;
    for (const key of path.split(".")) found = isNested(found) && key in found ? found[key] : null;
    return found;
  }

  const several = (document) => document.statistics.buses.length > 1;
  const columns = (document, section) =>
    section.columns.filter((column) => several(document) || !column.only_with_several_buses);

  function cell(document, column, row) {
    let value = valueAt(row, column.path || "");
    if (value === null && column.or) value = valueAt(row, column.or);
    if (value === null || value === undefined) return "";
    switch (column.as) {
      case "plot": return "";
      case "int": return fixed(value, 0);
      case "some": return value ? fixed(value, 0) : "";
      case "ms": return fixed(value / 1000, 3);
      case "seconds": return fixed(value / 1e6, 1);
      case "percent": return percent(value);
      case "share": {
        const whole = valueAt(row, column.of);
        return whole ? percent(value / whole) : "";
      }
      case "counts": return Object.entries(value).filter(([, count]) => count)
        .map(([key, count]) => `${visible(key)} ${fixed(count, 0)}`).join(", ");
      case "total": return fixed(Object.values(value).reduce((sum, one) => sum + one, 0), 0);
      case "list": return visible(value.join(", "));
      case "function": return visible(`${value} ${document.functions[value] || ""}`.trim());
      case "yes": return value ? "yes" : "";
      default: return plain(value);
    }
  }

  function table(document, section) {
    const chosen = columns(document, section);
    const rows = rowsAt(document, section.rows).slice(0, section.most || 500);
    return rows.map((row) => chosen.map((column) => cell(document, column, row)));
  }

  function diagnoses(document) {
    const known = new Set(document.overview.examples.map((row) => row.txn));
    return document.doctor.diagnoses.map((row) => {
      const facts = several(document) ? [["bus", plain(row.bus)]] : [];
      for (const name of ["unit", "function", "address", "client"])
        if (row[name] !== null && row[name] !== undefined) facts.push([name, plain(row[name])]);
      facts.push(["seen in", `${fixed(row.failed, 0)} of ${fixed(row.total, 0)}`]);
      for (const name of ["since", "until"])
        if (row[name] !== null && row[name] !== undefined) facts.push([name, plain(row[name])]);
      return {
        level: SEVERITIES.includes(row.severity) ? row.severity : "info", title: visible(row.title || row.code), code: visible(row.code), facts,
        texts: [["", visible([row.sentence, row.evidence].filter(Boolean).join(" "))], ["Check", visible(row.advice)], ["Proof", visible(row.proof)]],
        examples: row.examples.filter((number) => known.has(number)),
      };
    });
  }

  function counts(row) {
    if (!row) return "";
    const failed = FAILED.reduce((sum, status) => sum + (row.statuses[status] || 0), 0);
    const refused = row.statuses.exception || 0, parts = [fixed(row.transactions, 0)];
    if (failed) parts.push(`${fixed(failed, 0)} failed`);
    if (refused) parts.push(`${fixed(refused, 0)} exception${refused === 1 ? "" : "s"}`);
    return parts.join(", ");
  }

  function matrix(document, section) {
    const rows = rowsAt(document, section.rows), found = new Map(), units = new Map();
    const bus = (row) => (several(document) ? row.bus : "");
    const functions = [...new Set(rows.map((row) => row.function))].sort((one, other) => one - other);
    for (const row of rows) {
      units.set(JSON.stringify([bus(row), row.unit]), [bus(row), row.unit]);
      found.set(JSON.stringify([bus(row), row.unit, row.function]), row);
    }
    const named = (code) => cell(document, { path: "function", as: "function" }, { function: code });
    return {
      head: ["unit", ...functions.map(named)],
      rows: [...units.values()].map(([name, unit]) => [`${visible(name)} ${unit}`.trim(),
        ...functions.map((code) => counts(found.get(JSON.stringify([name, unit, code]))))]),
    };
  }

  function examples(document) {
    return document.overview.examples.map((row) => {
      const words = [`transaction ${row.txn}`];
      if (several(document)) words.push(visible(row.bus));
      words.push(`unit ${row.unit}`, "function " + cell(document, { path: "function", as: "function" }, row));
      words.push(visible(row.status).replaceAll("_", " "));
      for (const [name, title] of [["response_time_us", "answered after"], ["waited_us", "waited"]])
        if (row[name] !== null) words.push(`${title} ${fixed(row[name] / 1000, 3)} ms`);
      if (row.time !== null) words.push(visible(row.time));
      const frames = (row.frames || []).map((one) => ({
        title: visible(one.title),
        rows: one.pieces.map(([offset, data, name, value, meaning, isValid]) => ({
          cells: [String(offset), visible(data), visible(name), visible(value), visible(meaning || "")], wrong: !isValid,
        })),
      }));
      return { txn: row.txn, title: words.join(", "), findings: visible(row.findings.join(", ")), frames };
    });
  }

  return { VERDICTS, visible, fixed, plain, rowsAt, columns, table, diagnoses, matrix, examples };
})();
