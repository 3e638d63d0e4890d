// The bytes of a frame beside their meaning, as the core has them.
const Bytes = (() => {
  const el = Show.el;
  const spaced = (hex) => hex.replace(/(..)(?=.)/g, "$1 ");
  const TITLES = ["offset", "bytes", "field", "value", "meaning"];

  // A heading, and a table with a line for each block.
  function table({ title, blocks }) {
    const lines = blocks.map(([offset, hex, name, value, meaning, isValid]) => {
      const cells = [String(offset), spaced(hex), name, value, isValid ? meaning : `\u26A0 ${meaning}`];
      return el("tr", isValid ? {} : { class: "invalid" }, ...cells.map((text, at) => el("td", at === 1 ? { class: "hex" } : {}, Show.visible(text))));
    });
    const head = el("tr", {}, ...TITLES.map((text) => el("th", { scope: "col" }, text)));
    return [el("h3", {}, title || "bytes"), el("table", { class: "bytes" }, el("thead", {}, head), el("tbody", {}, ...lines))];
  }

  return { table, spaced };
})();
