// What chooses rows: a filter in words, and lists beside it for those who do not want to type one.
const Filters = (() => {
  const $ = (id) => document.getElementById(id);
  const FAILED = "status in ('no_response', 'bad_request', 'bad_response')";
  // A filter that each table knows, shown while none is typed.
  const EXAMPLES = {
    transactions: "status != 'ok' and response_time_us > 50e3", frames: "verdict == 'bad_checksum' and unit == 1",
    findings: "severity == 'error' and unit == 1", connections: "reset or requests > answered",
  };
  // The filter that was typed last and is right for this table.
  let typed = "";

  // The lists, for the rows of a table.
  function fill(table, statistics) {
    const units = [...new Set(statistics.buses.flatMap((bus) => bus.units.map((one) => one.unit)))].sort((a, b) => a - b);
    const list = (id, texts, all) => {
      const before = $(id).value;
      $(id).replaceChildren(Show.el("option", { value: "" }, all), ...texts.map((one) => Show.el("option", { value: String(one) }, String(one))));
      if (texts.map(String).includes(before)) $(id).value = before;
    };
    $("where").placeholder = EXAMPLES[table];
    list("unit", units, "all units");
    list("finding", Object.keys(statistics.findings), "all findings");
    $("failed-label").hidden = table !== "transactions";
    $("unit-label").hidden = $("finding-label").hidden = table === "connections";
  }

  // The changes of this computer's offset from UTC, in seconds: from when on one holds, and the offset.
  function localChanges() {
    const WEEK = 7 * 86400, offset = (at) => -60 * new Date(at * 1000).getTimezoneOffset();
    const found = [[-4e9, offset(631152000)]];
    for (let at = 631152000; at < 2840140800; at += WEEK) {
      if (offset(at) === offset(at + WEEK)) continue;
      let low = at, high = at + WEEK;
      while (high - low > 1) {
        const middle = Math.floor((low + high) / 2);
        if (offset(middle) === offset(low)) low = middle;
        else high = middle;
      }
      found.push([high, offset(high)]);
    }
    return found;
  }

  const zoned = (text) => ({ where: text, ...(/local/.test(text) ? { local: localChanges() } : {}) });

  // Takes what was typed, if it is a filter of this table; if not, what is wrong is said, and no filter in words holds.
  async function check(table, ask) {
    const text = $("where").value.trim();
    const say = (words, isWrong) => {
      $("where-said").textContent = words;
      $("where-said").classList.toggle("is-error", isWrong);
      $("where").setAttribute("aria-invalid", String(isWrong));
    };
    typed = "";
    say("", false);
    if (!text) return;
    try {
      const { notes } = await ask({ call: "check", table, ...zoned(text) });
      typed = text;
      say(Here.text(notes.join("; ")), false);
    } catch (error) {
      say(`${Here.text(error.message)}; rows are shown without this filter`, true);
    }
  }

  // The filter of a table, as the core takes it.
  function of(table) {
    const parts = typed ? [typed] : [];
    const unit = $("unit").value, finding = $("finding").value;
    if (unit && table !== "connections") parts.push(`unit == ${unit}`);
    if ($("failed").checked && table === "transactions") parts.push(FAILED);
    if (finding && table !== "connections") parts.push(table === "findings" ? `code == '${finding}'` : `'${finding}' in findings`);
    return zoned(parts.length > 1 ? parts.map((one) => `(${one})`).join(" and ") : parts[0] || "");
  }

  function clear() {
    typed = "";
    $("unit").value = $("finding").value = $("where").value = "";
    $("failed").checked = false;
  }

  return { fill, check, of, clear };
})();
