// The model as elements: what page.py writes as HTML. Text goes in as text only.
const Render = (() => {
  const RIGHT = ["number", "int", "some", "ms", "seconds", "percent", "share", "total"];
  const PIECES = ["offset", "bytes", "field", "value", "meaning"];
  const URGENT = 3;

  function el(name, attributes, ...children) {
    const made = document.createElement(name);
    for (const key in attributes) made.setAttribute(key, attributes[key]);
    for (const child of children) made.append(child);
    return made;
  }

  function body(data, layout) {
    const names = data.sources.map((source) => source.name).join(", ");
    const verdict = el("p", { class: `verdict ${data.doctor.verdict in Model.VERDICTS ? data.doctor.verdict : "unknown"}` },
      el("strong", {}, Model.VERDICTS[data.doctor.verdict] || "unknown"), " " + Model.visible(data.doctor.sentence));
    const header = el("header", {}, el("h1", {}, "Modbus report"), el("p", { class: "source" }, Model.visible(names)), verdict);
    return [header, diagnoses(data), ...layout.section.map((one) => section(data, one))];
  }

  function diagnoses(data) {
    const made = el("section", { id: "diagnoses" }, el("h2", {}, "What to do first"));
    const cards = Model.diagnoses(data);
    if (!cards.length) made.append(el("p", { class: "empty" }, "No cause of trouble was found."));
    cards.forEach((card, at) => {
      const details = el("details", { class: `card ${card.level}` });
      details.open = at < URGENT;
      details.append(el("summary", {}, el("span", { class: "level" }, card.level), " ",
        el("strong", {}, `${at + 1}. ${card.title}`), " ", el("code", {}, card.code)));
      details.append(el("dl", {}, ...card.facts.map(([name, to]) => el("div", {}, el("dt", {}, name), el("dd", {}, to)))));
      for (const [name, text] of card.texts)
        details.append(name ? el("p", {}, el("strong", {}, name + ":"), " " + text) : el("p", {}, text));
      if (card.examples.length) {
        const links = el("p", {}, "Example transactions: ");
        card.examples.forEach((txn, number) => links.append(number ? ", " : "", el("a", { href: `#txn-${txn}` }, String(txn))));
        details.append(links);
      }
      made.append(details);
    });
    return made;
  }

  function section(data, one) {
    const made = el("section", { id: one.id }, el("h2", {}, one.title));
    if (one.text) made.append(el("p", {}, one.text));
    if (one.plot) made.append(el("div", { class: "plot script-only", "data-plot": one.plot }));
    if (one.examples) {
      const found = Model.examples(data);
      made.append(...(found.length ? found.map(example) : [el("p", { class: "empty" }, one.empty)]));
      return made;
    }
    const columns = one.matrix ? [] : Model.columns(data, one);
    const found = one.matrix ? Model.matrix(data, one)
      : { head: columns.map((column) => column.title), rows: Model.table(data, one) };
    if (!found.rows.length) {
      made.append(el("p", { class: "empty" }, one.empty));
      return made;
    }
    made.append(table(one.title, found, columns.map((column) => RIGHT.includes(column.as))));
    const more = one.matrix ? 0 : Model.rowsAt(data, one.rows).length - found.rows.length;
    if (more > 0) made.append(el("p", { class: "more" }, `${Model.fixed(more, 0)} more are in the document.`));
    return made;
  }

  function table(title, { head, rows }, right) {
    const names = el("tr", {}, ...head.map((name) => el("th", { scope: "col" }, name)));
    const cells = (row) => row.map((text, at) => el("td", right[at] ? { class: "n" } : {}, text));
    const all = el("table", {}, el("thead", {}, names), el("tbody", {}, ...rows.map((row) => el("tr", {}, ...cells(row)))));
    return el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": title }, all);
  }

  function example(one) {
    const made = el("details", { class: "example", id: `txn-${one.txn}` }, el("summary", {}, one.title));
    if (one.findings) made.append(el("p", {}, one.findings));
    for (const frame of one.frames) {
      const head = el("tr", {}, ...PIECES.map((name) => el("th", { scope: "col" }, name)));
      const rows = frame.rows.map((row) => el("tr", row.wrong ? { class: "wrong" } : {}, ...row.cells.map((text) => el("td", {}, text))));
      made.append(el("div", { class: "scroll" },
        el("table", { class: "bytes" }, el("caption", {}, frame.title), el("thead", {}, head), el("tbody", {}, ...rows))));
    }
    return made;
  }

  return { el, body };
})();
