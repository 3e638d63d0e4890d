// What the page does when it is open: reads the document in it, draws, opens what a link names, prints.
(() => {
  const layout = JSON.parse(document.getElementById("layout").content.textContent);

  async function embedded() {
    const bytes = Uint8Array.from(atob(document.getElementById("data").content.textContent), (one) => one.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return JSON.parse(await new Response(stream).text());
  }

  // Until then, and where that fails, the page has no headings, legends and hints of what is not there.
  function draw(data) {
    document.body.classList.add("scripted");
    Plots.all(data, layout);
    RowFilter.all(layout);
    openTarget();
    document.documentElement.dataset.state = "drawn";
  }

  // A link to an example opens it.
  function openTarget() {
    const target = location.hash.startsWith("#txn-") && document.getElementById(location.hash.slice(1));
    if (!target) return;
    target.open = true;
    target.scrollIntoView();
  }

  function start() {
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
        draw(await embedded());
      } catch (error) {
        Show.say(`The plots could not be drawn: ${error.message}`);
        throw error;
      }
    }));
  }

  start();
})();
