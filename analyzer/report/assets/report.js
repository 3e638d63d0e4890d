// What the page does when it is open: reads the document in it, draws, filters, takes other documents.
const Report = (() => {
  const FORMAT = "modlens report", VERSION = 1, MOST_AT_A_GLANCE = 4;
  const layout = JSON.parse(document.getElementById("layout").content.textContent);

  const say = (text) => { document.getElementById("said").textContent = text; };

  async function embedded() {
    const text = document.getElementById("data").content.textContent;
    if (!text) return null;
    const bytes = Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return JSON.parse(await new Response(stream).text());
  }

  function draw(data) {
    Plots.all(data, layout);
    for (const section of layout.section) if (section.filter) addFilter(section);
    openTarget();
    document.documentElement.dataset.state = "drawn";
  }

  function show(data) {
    if (data?.format !== FORMAT) throw new Error("this is not a document of modlens stats --to json");
    if (data.version !== VERSION) throw new Error(`this page reads version ${VERSION} of the document, not ${data.version}`);
    document.getElementById("report").replaceChildren(...Render.body(data, layout));
    draw(data);
  }

  async function take(file) {
    try {
      show(JSON.parse(await file.text()));
      say(`${Model.visible(file.name)} is shown.`);
      window.scrollTo(0, 0);
    } catch (error) {
      say(`${Model.visible(file.name)} is not shown: ${Model.visible(String(error.message))}`);
    }
  }

  // A filter above a table: NAME=VALUE has to be in the column of that name, the words between somewhere in the row.
  function addFilter({ id, title, examples }) {
    const section = document.getElementById(id), table = section?.querySelector(":scope > .scroll > table");
    if (!section) return;
    const rows = examples ? [...section.querySelectorAll(".example")] : table ? [...table.tBodies[0].rows] : [];
    section.querySelector(":scope > .filter")?.remove();
    if (rows.length <= MOST_AT_A_GLANCE) return;
    const names = examples ? [] : [...table.tHead.rows[0].cells].map((one) => one.textContent.toLowerCase());
    const name = names.includes("unit") || examples ? "unit" : names[0];
    const input = Render.el("input", { type: "search", id: `filter-${id}`, autocomplete: "off", placeholder: `words, or ${name}=…` });
    const tools = Render.el("div", { class: "tools filter" }, Render.el("label", {}, `Filter ${title.toLowerCase()} `, input));
    (examples ? rows[0] : table.parentElement).before(tools);
    input.addEventListener("input", () => {
      const [pairs, words] = [true, false].map((isPair) => input.value.trim().toLowerCase().split(/\s+/).filter((word) => word.includes("=") === isPair));
      const text = words.join(" ");
      for (const row of rows) row.hidden = !row.textContent.toLowerCase().includes(text) || !pairs.every((pair) => matches(row, names, pair));
      say(`${Model.fixed(rows.filter((row) => !row.hidden).length, 0)} of ${Model.fixed(rows.length, 0)} are shown.`);
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

  // A link to an example opens it.
  function openTarget() {
    const target = location.hash.startsWith("#txn-") && document.getElementById(location.hash.slice(1));
    if (!target) return;
    target.open = true;
    target.scrollIntoView();
  }

  function drop() {
    const body = document.body;
    body.addEventListener("dragover", (event) => { event.preventDefault(); body.classList.add("dropping"); });
    body.addEventListener("dragleave", () => body.classList.remove("dropping"));
    body.addEventListener("drop", (event) => {
      event.preventDefault();
      body.classList.remove("dropping");
      if (event.dataTransfer.files.length) take(event.dataTransfer.files[0]);
    });
    document.getElementById("file").addEventListener("change", (event) => event.target.files.length && take(event.target.files[0]));
  }

  function start() {
    document.body.classList.add("scripted");
    drop();
    window.addEventListener("hashchange", openTarget);
    let waiting = 0;
    window.addEventListener("resize", () => { clearTimeout(waiting); waiting = setTimeout(() => Plots.resize(matchMedia("print").matches), 100); });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", Plots.redraw);
    // On paper: the width of a page, and the transactions that a cause names with their bytes. Before the event only the
    // page's own width is known; after it only the colours of paper.
    const paper = (isPaper) => {
      for (const one of document.querySelectorAll(".example.named")) one.open = isPaper;
      Plots.resize(isPaper);
    };
    window.addEventListener("beforeprint", () => paper(true));
    window.addEventListener("afterprint", () => paper(false));
    matchMedia("print").addEventListener("change", ({ matches }) => paper(matches));
    // Parsed when the page has been painted.
    requestAnimationFrame(() => setTimeout(async () => {
      try {
        const data = await embedded();
        if (data) draw(data);
        else document.documentElement.dataset.state = "empty";
      } catch (error) {
        say(`The plots could not be drawn: ${error.message}`);
        throw error;
      }
    }));
  }

  start();
  return { say };
})();
