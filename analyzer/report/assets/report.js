// What the page does when it is open: reads the document in it, draws, filters, takes other documents.
const Report = (() => {
  const FORMAT = "modlens report", VERSION = 1;
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
    Plots.all(data);
    for (const section of layout.section) if (section.filter) addFilter(section.filter);
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

  function addFilter(id) {
    const section = document.getElementById(id), rows = [...section.querySelectorAll(id === "examples" ? ".example" : ":scope > .scroll > table > tbody > tr")];
    section.querySelector(":scope > .tools")?.remove();
    if (rows.length < 2) return;
    const input = Render.el("input", { type: "search", id: `filter-${id}`, autocomplete: "off" });
    const tools = Render.el("div", { class: "tools" }, Render.el("label", {}, "Filter ", input));
    section.querySelector("h2").after(tools);
    input.addEventListener("input", () => {
      const wanted = input.value.trim().toLowerCase();
      let count = 0;
      for (const row of rows) {
        row.hidden = !row.textContent.toLowerCase().includes(wanted);
        count += row.hidden ? 0 : 1;
      }
      say(`${Model.fixed(count, 0)} of ${Model.fixed(rows.length, 0)} are shown.`);
    });
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
    window.addEventListener("resize", () => { clearTimeout(waiting); waiting = setTimeout(Plots.resize, 100); });
    for (const query of ["(prefers-color-scheme: dark)", "print"]) matchMedia(query).addEventListener("change", Plots.redraw);
    window.addEventListener("beforeprint", () => {
      for (const one of document.querySelectorAll(".card")) one.open = true;
    });
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
