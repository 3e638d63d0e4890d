// The model as elements: what page.py writes as HTML. Text goes in as text only.
const Render = (() => {
  const PIECES = ["offset", "bytes", "field", "value", "meaning"];

  function el(name, attributes, ...children) {
    const made = document.createElement(name);
    for (const key in attributes) made.setAttribute(key, attributes[key]);
    for (const child of children) made.append(child);
    return made;
  }

  function body(data, layout) {
    const URGENT = Model.URGENT, top = Model.summary(data), found = Model.diagnoses(data), first = found.slice(0, URGENT), rest = found.slice(URGENT);
    const verdict = el("p", { class: `verdict ${data.doctor.verdict in Model.VERDICTS ? data.doctor.verdict : "unknown"}` },
      el("strong", {}, Model.VERDICTS[data.doctor.verdict] || "unknown"), " " + Model.visible(data.doctor.sentence));
    const header = el("header", {}, el("h1", {}, top.name), el("p", { class: "period" }, top.period), verdict);
    const now = causes("diagnoses", "What to do first", first, 1), parts = [header, now];
    if (!found.length) now.append(el("p", { class: "empty" }, "No cause of trouble was found."));
    if (rest.length) now.append(el("p", { class: "more" }, el("a", { href: "#more-causes" }, `${rest.length} more in the appendix`)));
    parts.push(el("p", { class: "basis" }, `Based on ${top.sources}.`));
    for (const one of Model.sections(data, layout)) {
      if (one.appendix) {
        parts.push(el("h2", { class: "part" }, "Appendix"));
        if (rest.length) parts.push(causes("more-causes", "More causes", rest, URGENT + 1));
      }
      parts.push(section(data, one));
    }
    return parts;
  }

  function causes(name, title, cards, first) {
    const made = el("section", { id: name }, el("h2", {}, title));
    cards.forEach((card, at) => {
      const article = el("article", { class: `card ${card.level}` }, el("h3", {}, el("span", { class: "level" }, card.level), " ",
        `${first + at}. ${card.title} `, el("code", {}, card.code)));
      for (const [head, text] of card.texts)
        article.append(head ? el("p", {}, el("strong", {}, head + ":"), " " + text) : el("p", {}, text));
      const facts = card.facts.map(([fact, to]) => el("div", {}, el("dt", {}, fact), el("dd", {}, to)));
      if (card.examples.length) {
        const links = el("dd", {});
        card.examples.forEach((txn, number) => links.append(number ? ", " : "", el("a", { href: `#txn-${txn}` }, String(txn))));
        facts.push(el("div", {}, el("dt", {}, "example transactions"), links));
      }
      article.append(el("dl", {}, ...facts));
      made.append(article);
    });
    return made;
  }

  function section(data, one) {
    const made = el("section", { id: one.id }, el("h2", {}, one.title)), count = Model.rowsAt(data, one.rows).length;
    if (count && one.text) made.append(el("p", {}, one.text));
    if (count && one.hint) made.append(el("p", { class: "hint script-only" }, one.hint));
    if (one.draw || one.plots) made.append(el("div", { class: "plot script-only", "data-plot": one.id }));
    if (count && one.legend) made.append(el("p", { class: "legend script-only" },
      ...one.legend.map(([colour, meaning]) => el("span", {}, el("i", { class: `swatch ${colour}` }), meaning))));
    if (!count) made.append(el("p", { class: "empty" }, one.empty));
    else if (one.examples) made.append(...Model.examples(data).map(example));
    else {
      const found = one.matrix ? Model.matrix(data, one) : Model.table(data, one), more = one.matrix ? 0 : count - found.rows.length;
      made.append(table(one.title, found));
      if (more > 0) made.append(el("p", { class: "more" }, `${Model.fixed(more, 0)} more are in the document.`));
    }
    return made;
  }

  function table(title, { head, rows, right }) {
    const names = el("tr", {}, ...head.map((name) => el("th", { scope: "col" }, name)));
    const cells = (row) => row.map((text, at) => el("td", right[at] ? { class: "n" } : {}, text));
    const all = el("table", {}, el("thead", {}, names), el("tbody", {}, ...rows.map((row) => el("tr", {}, ...cells(row)))));
    return el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": title }, all);
  }

  function example(one) {
    const made = el("details", { class: one.named ? "example named" : "example", id: `txn-${one.txn}` }, el("summary", {}, one.title));
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
