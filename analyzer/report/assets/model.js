// What a report shows of a document: the words of model.py, for documents that are dropped on the page.
"use strict";
const Model = (() => {
  const ESCAPED = /[\u0000-\u001f\u007f-\u009f\u00ad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ud800-\udfff]|[\u{e0000}-\u{e007f}]/gu;
  const SHORT = { "\t": "\\t", "\n": "\\n", "\r": "\\r" };
  const VERDICTS = { healthy: "healthy", trouble: "trouble", broken: "broken", unknown: "not enough to judge" };
  const URGENT = 3, PRINTED = 2;
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

  // 0 % and 100 % are shown for none and all only.
  function percent(share) {
    if (share === 0 || share === 1) return share ? "100 %" : "0 %";
    const [least, most] = share > 0 && share < 1 ? [0.1, 99.9] : [0, Infinity];
    return fixed(Math.min(Math.max(share * 100, least), most), 1) + " %";
  }

  function milliseconds(us) {
    const value = us / 1000;
    return fixed(value, [1, 10, 100].filter((limit) => value < limit).length);
  }

  function moment(text) {
    const found = /^(\d{4}-\d\d-\d\d)T(\d\d:\d\d:\d\d)(?:\.(\d+))?Z?$/.exec(text);
    return found ? `${found[1]} ${found[2]}.${(found[3] || "").padEnd(3, "0").slice(0, 3)}` : visible(text);
  }

  const words = (text) => visible(text).replaceAll("_", " ");

  const summary = (document) => Object.fromEntries(["name", "period", "sources"].map((key) => [key, visible(document.summary?.[key] || "")]));

  const sections = (document, layout) =>
    layout.section.filter(({ optional, rows }) => !optional || rowsAt(document, optional === true ? rows : optional).length);

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
      case "ms": return milliseconds(value);
      case "seconds": return fixed(value / 1e6, 1);
      case "percent": return percent(value);
      case "load": return value ? percent(value) : "";
      case "share": {
        const whole = valueAt(row, column.of);
        return whole ? percent(value / whole) : "";
      }
      case "counts": return Object.entries(value).filter(([, count]) => count)
        .map(([key, count]) => `${words(key)} ${fixed(count, 0)}`).join(", ");
      case "total": return fixed(Object.values(value).reduce((sum, one) => sum + one, 0), 0);
      case "list": return visible(value.join(", "));
      case "function": return visible(`${value} ${document.functions[value] || ""}`.trim());
      case "yes": return value ? "yes" : "";
      case "words": return words(value);
      case "time": return moment(String(value));
      default: return plain(value);
    }
  }

  const RIGHT = ["number", "int", "some", "ms", "seconds", "percent", "load", "share", "total"];

  function table(document, section) {
    const chosen = columns(document, section), found = rowsAt(document, section.rows).slice(0, section.most || 500);
    const texts = chosen.map((column) => found.map((row) => cell(document, column, row)));
    const kept = chosen.map((_, at) => at).filter((at) => chosen[at].as === "plot" || texts[at].some(Boolean));
    return {
      head: kept.map((at) => chosen[at].title), rows: found.map((_, number) => kept.map((at) => texts[at][number])),
      right: kept.map((at) => RIGHT.includes(chosen[at].as)),
    };
  }

  function titleOf(row) {
    const title = visible(row.title || row.code);
    return row.unit === null || row.unit === undefined ? title.slice(0, 1).toUpperCase() + title.slice(1) : `Unit ${row.unit}: ${title}`;
  }

  function diagnoses(document) {
    const known = new Set(document.overview.examples.map((row) => row.txn));
    return document.doctor.diagnoses.map((row) => {
      const facts = several(document) ? [["bus", plain(row.bus)]] : [];
      for (const name of ["unit", "function", "address", "client"])
        if (row[name] !== null && row[name] !== undefined) facts.push([name, plain(row[name])]);
      facts.push(["seen in", `${fixed(row.failed, 0)} of ${fixed(row.total, 0)}`]);
      for (const name of ["since", "until"])
        if (row[name] !== null && row[name] !== undefined) facts.push([name, moment(String(row[name]))]);
      if ((row.certainty ?? "diagnosed") !== "diagnosed") facts.push(["certainty", visible(row.certainty)]);
      return {
        level: SEVERITIES.includes(row.severity) ? row.severity : "info", title: titleOf(row), code: visible(row.code), facts,
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
      right: [],
    };
  }

  function examples(document) {
    const named = new Set(document.doctor.diagnoses.slice(0, URGENT).flatMap((row) => row.examples.slice(0, PRINTED)));
    const last = (row) => (named.has(row.txn) ? 0 : 1);
    return [...document.overview.examples].sort((one, other) => last(one) - last(other)).map((row) => {
      const facts = [`transaction ${row.txn}`];
      if (several(document)) facts.push(visible(row.bus));
      facts.push(`unit ${row.unit}`, "function " + cell(document, { path: "function", as: "function" }, row));
      facts.push(words(row.status));
      for (const [name, title] of [["response_time_us", "answered after"], ["waited_us", "waited"]])
        if (row[name] !== null) facts.push(`${title} ${milliseconds(row[name])} ms`);
      if (row.time !== null) facts.push(moment(row.time));
      const frames = (row.frames || []).map((one) => ({
        title: visible(one.title),
        rows: one.pieces.map(([offset, data, name, value, meaning, isValid]) => ({
          cells: [String(offset), visible(data), visible(name), visible(value), visible(meaning || "")], wrong: !isValid,
        })),
      }));
      return { txn: row.txn, title: facts.join(", "), named: named.has(row.txn), findings: visible(row.findings.join(", ")), frames };
    });
  }

  return { URGENT, VERDICTS, visible, fixed, milliseconds, percent, summary, sections, rowsAt, table, diagnoses, matrix, examples };
})();
