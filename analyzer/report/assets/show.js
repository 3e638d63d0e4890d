// What scripts need to show a value: elements, texts, rows. The core writes everything that is read without scripts.
"use strict";
const Show = (() => {
  const ESCAPED = /[\u0000-\u001f\u007f-\u009f\u00ad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ud800-\udfff]|[\u{e0000}-\u{e007f}]/gu;
  const SHORT = { "\t": "\\t", "\n": "\\n", "\r": "\\r" };

  function el(name, attributes, ...children) {
    const made = document.createElement(name);
    for (const key in attributes) made.setAttribute(key, attributes[key]);
    for (const child of children) made.append(child);
    return made;
  }

  function visible(text) {
    return text.replace(ESCAPED, (one) => {
      const code = one.codePointAt(0), hex = (digits) => code.toString(16).padStart(digits, "0");
      return SHORT[one] || (code < 256 ? "\\x" + hex(2) : code < 65536 ? "\\u" + hex(4) : "\\U" + hex(8));
    });
  }

  const say = (text) => { document.getElementById("said").textContent = visible(text); };

  // Halves are rounded away from 0.
  function fixed(value, decimals) {
    const scale = 10 ** decimals, scaled = Math.floor(Math.abs(value) * scale + 0.5) / scale;
    return (value < 0 && scaled ? -scaled : scaled).toLocaleString("en-US", { minimumFractionDigits: decimals, maximumFractionDigits: decimals });
  }

  // About three digits.
  function milliseconds(us) {
    const value = us / 1000;
    return fixed(value, [1, 10, 100].filter((limit) => value < limit).length);
  }

  // Rows of all buses; each names its bus.
  const ofBuses = (buses, rowsOf) => buses.flatMap((bus) => (rowsOf(bus) || []).map((row) => ({ bus: bus.bus, ...row })));

  return { el, say, visible, fixed, milliseconds, ofBuses };
})();
