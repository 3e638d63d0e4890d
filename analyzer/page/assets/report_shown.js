// The report on the page: verdict and causes in front of the tables, the rest behind them, and all of it as a file.
const Report = (() => {
  const layout = JSON.parse(document.getElementById("layout").content.textContent);
  const $ = (id) => document.getElementById(id);
  let report = null, drawing = 0;

  // Verdict and causes, which stand in front of the tables; returns the HTML of the rest, section by section.
  function verdict(made, hasTables) {
    report = made;
    const body = hasTables ? Here.text(made.body) : made.body;
    const [verdict, causes, ...parts] = body.split(/(?=<section )/);
    drawing++;
    document.documentElement.dataset.report = "waiting";
    $("results").hidden = false;
    $("rows").hidden = !hasTables;
    $("verdict").replaceChildren(...elements(verdict), ...elements(causes));
    return parts;
  }

  function elements(html) {
    const holder = document.createElement("template");
    holder.innerHTML = html;
    return holder.content.children;
  }

  // The elements of a section; examples are rows of the tables where there are any.
  const sections = (html) => [...elements(html)].filter((one) => $("rows").hidden || one.id !== "examples");

  // What stands behind the tables, one section or plot after the other, each in place of what was there: a line that is listened
  // to has a new report every few seconds. Between two of them the page is free, and what is still missing is left out where
  // another report has come.
  async function rest(parts) {
    const mine = drawing, host = $("report"), isNext = () => new Promise((resume) => setTimeout(() => resume(mine === drawing)));
    const made = parts.flatMap(sections);
    if (!made.length) return;
    for (const [at, section] of made.entries()) {
      if (!await isNext()) return;
      put(section, host.children[at]);
    }
    while (host.children.length > made.length) host.lastElementChild.remove();
    for (const step of Plots.inTurn(report.document, layout)) {
      void step;
      if (!await isNext()) return;
    }
    RowFilter.all(layout);
    document.documentElement.dataset.report = "drawn";
  }

  // Puts a section in place of an old one, whose plots stay until those of the new one are drawn.
  function put(section, old) {
    if (!old) return $("report").append(section);
    const plots = old.id === section.id && old.querySelector("[data-plot]");
    if (plots) section.querySelector("[data-plot]")?.replaceChildren(...plots.childNodes);
    old.replaceWith(section);
  }

  // Nothing, before another recording is shown.
  function clear() {
    drawing++;
    $("report").replaceChildren();
  }

  // The page that modlens report writes of the document: its frame is in this page, style and scripts are those of this page.
  async function file() {
    const packed = new Blob([JSON.stringify(report.document)]).stream().pipeThrough(new CompressionStream("gzip"));
    const bytes = new Uint8Array(await new Response(packed).arrayBuffer());
    const parts = {
      title: report.title, body: report.body, data: btoa(Array.from(bytes, (one) => String.fromCharCode(one)).join("")),
      style: document.querySelector("style").textContent, script: document.querySelector("script").textContent,
    };
    return new Blob([$("frame").content.textContent.replace(/@@(\w+)@@/g, (_, part) => parts[part])], { type: "text/html" });
  }

  return { verdict, rest, clear, file };
})();
