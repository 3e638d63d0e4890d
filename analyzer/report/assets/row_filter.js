// Filters above the tables of a report that have many rows.
const RowFilter = (() => {
  const MOST_AT_A_GLANCE = 4;

  // A filter above a table: NAME=VALUE has to be in the column of that name, the words between somewhere in the row.
  function add({ id, title, examples }) {
    const section = document.getElementById(id), table = section?.querySelector(":scope > .scroll > table");
    if (!section) return;
    const rows = examples ? [...section.querySelectorAll(".example")] : table ? [...table.tBodies[0].rows] : [];
    section.querySelector(":scope > .filter")?.remove();
    if (rows.length <= MOST_AT_A_GLANCE) return;
    const names = examples ? [] : [...table.tHead.rows[0].cells].map((one) => one.textContent.toLowerCase());
    const name = names.includes("unit") || examples ? "unit" : names[0];
    const input = Show.el("input", { type: "search", id: `filter-${id}`, autocomplete: "off", placeholder: `words, or ${name}=…` });
    const tools = Show.el("div", { class: "tools filter" }, Show.el("label", {}, `Filter ${title.toLowerCase()} `, input));
    (examples ? rows[0] : table.parentElement).before(tools);
    input.addEventListener("input", () => {
      const [pairs, words] = [true, false].map((isPair) => input.value.trim().toLowerCase().split(/\s+/).filter((word) => word.includes("=") === isPair));
      const text = words.join(" ");
      for (const row of rows) row.hidden = !row.textContent.toLowerCase().includes(text) || !pairs.every((pair) => matches(row, names, pair));
      Show.say(`${Show.fixed(rows.filter((row) => !row.hidden).length, 0)} of ${Show.fixed(rows.length, 0)} are shown.`);
    });
  }

  function matches(row, names, pair) {
    const [name, value] = pair.split("="), column = names.indexOf(name);
    // An example says it in words: "unit 3, function 4 Read ...".
    if (column < 0) return ` ${row.textContent.toLowerCase()}`.replaceAll(",", " ").includes(` ${name} ${value} `);
    const text = row.cells[column].textContent.toLowerCase();
    // A function is written with its name behind its number.
    return text === value || text.split(" ")[0] === value;
  }

  function all(layout) {
    for (const section of layout.section) if (section.filter) add(section);
  }

  return { all };
})();
