// The plots of a document. Colours come from the style sheet, so that they follow dark, light and paper.
const Plots = (() => {
  const MOST_BUSES = 8, MOST_TOGETHER = 8, FIGURES = 120;
  const PALETTE = ["#2f7ed8", "#e07b39", "#3aa76d", "#b05fc4", "#c94f4f", "#7a8b99", "#c2a01e", "#2aa5b5"];
  const el = Render.el;
  let drawn = [];

  // Looked up once for each time that all is drawn: to ask costs more than to paint.
  let colours = {};
  const colour = (name) => (colours[name] ??= getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim());

  // The middle of each bucket: seconds, or numbers of transactions.
  function positions(steps, axis) {
    const scale = axis === "transactions" ? 1 : 1e-6;
    return Array.from({ length: steps.count }, (_, at) => (steps.start + (at + 0.5) * steps.step) * scale);
  }

  // Times of day as they are written elsewhere; the date stands beside the axis.
  function clock(plot, stamps) {
    const step = stamps.length > 1 ? stamps[1] - stamps[0] : 60, digits = step < 0.001 ? 6 : step < 1 ? 3 : 0;
    return stamps.map((at) => {
      const text = new Date(Math.floor(at) * 1000).toISOString();
      if (step >= 86400) return text.slice(0, 10);
      return text.slice(11, step < 60 ? 19 : 16) + (digits ? (at - Math.floor(at)).toFixed(digits).slice(1) : "");
    });
  }

  function axes(axis, unit, x) {
    const common = { stroke: () => colour("dim"), grid: { stroke: () => colour("line"), width: 1 }, ticks: { stroke: () => colour("line") } };
    const day = axis === "utc" && x.length ? new Date(x[0] * 1000).toISOString().slice(0, 10) : "";
    const label = { utc: `time on ${day} (UTC)`, relative: "seconds from the start", transactions: "transaction" }[axis];
    return [{ ...common, label, labelSize: 18, size: 34, space: 80, values: axis === "utc" ? clock : undefined }, { ...common, label: unit, labelSize: 18, size: 56 }];
  }

  // One plot: title, x, and series of [name, values, options]. Zooming one zooms all with the same axis.
  function plot(host, title, axis, unit, x, series, options = {}) {
    const box = el("div", { role: "group", "aria-label": title }), place = el("div", {});
    box.append(el("h3", {}, title), place);
    host.append(box);
    const lines = series.map(([label, , style], at) => ({
      label, stroke: style?.colour ? () => colour(style.colour) : PALETTE[at % PALETTE.length], width: style?.width ?? 1.5,
      fill: style?.bars ? (style.colour ? () => colour(style.colour) : PALETTE[at % PALETTE.length]) : undefined,
      dash: style?.dash, points: { show: style?.points ?? false, size: 4 }, spanGaps: !style?.gaps,
      paths: style?.bars ? uPlot.paths.bars({ size: [0.9, 24, 1] }) : style?.steps ? uPlot.paths.stepped({ align: 1 }) : undefined,
      value: (_, value) => (value === null || value === undefined ? "" : Model.fixed(value, options.decimals ?? 2)),
    }));
    const bands = (options.bands || []).map(([from, to]) => ({ series: [from, to], fill: PALETTE[0] + "33" }));
    const one = new uPlot({
      width: width(host), height: options.height || 150, pxAlign: 0,
      tzDate: (stamp) => uPlot.tzDate(new Date(stamp * 1000), "Etc/UTC"),
      scales: { x: { time: axis === "utc", distr: options.logarithmic ? 3 : 1 }, y: { range: (_, least, most) => range(least, most, options) } },
      axes: axes(options.logarithmic ? null : axis, unit, x), bands,
      series: [{ label: options.xLabel || { utc: "time", relative: "s", transactions: "transaction" }[axis],
        value: (_, value) => (value === null ? "" : axis === "utc" ? new Date(value * 1000).toISOString() : Model.fixed(value, 3)) }, ...lines],
      cursor: { drag: { x: !options.logarithmic, y: false }, sync: options.logarithmic ? undefined : { key: axis } },
      hooks: { setScale: [(plot, key) => key === "x" && zoomed(plot, axis)] },
    }, [x, ...series.map(([, values]) => values)], place);
    one.over.parentElement.querySelector("canvas").setAttribute("aria-label", `${title}: a plot; its figures are in the table below`);
    one.over.parentElement.querySelector("canvas").setAttribute("role", "img");
    if (options.logarithmic) drawn.push({ plot: one, host, axis: null });
    else drawn.push({ plot: one, host, axis });
    box.append(figures(one, title, series.map(([name]) => name)));
    return one;
  }

  function range(least, most, options) {
    if (least === null || most === null) return [0, 1];
    if (options.fromZero !== false) return [Math.min(0, least), most > 0 ? most * 1.05 : 1];
    return least === most ? [least - 1, most + 1] : [least - (most - least) * 0.05, most + (most - least) * 0.05];
  }

  let zooming = false;
  function zoomed(from, axis) {
    if (zooming || !drawn.some((one) => one.plot === from && one.axis === axis)) return;
    zooming = true;
    const { min, max } = from.scales.x;
    for (const one of drawn) if (one.plot !== from && one.axis === axis && axis) one.plot.setScale("x", { min, max });
    zooming = false;
  }

  // The figures of a plot as a table, made when somebody opens it.
  function figures(one, title, names) {
    const made = el("details", {}, el("summary", {}, "Figures"));
    made.addEventListener("toggle", () => {
      if (!made.open) return;
      made.querySelector(".scroll")?.remove();
      const [x, ...columns] = one.data, { min, max } = one.scales.x, rows = [];
      x.forEach((at, number) => {
        if (at >= min && at <= max && columns.some((column) => column[number]) && rows.length < FIGURES)
          rows.push(el("tr", {}, el("td", {}, one.series[0].value(one, at)),
            ...columns.map((column, which) => el("td", { class: "n" }, one.series[which + 1].value(one, column[number])))));
      });
      const head = el("tr", {}, ...[one.series[0].label, ...names].map((name) => el("th", { scope: "col" }, name)));
      made.append(el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": `Figures of ${title}` },
        el("table", {}, el("thead", {}, head), el("tbody", {}, ...rows))));
    });
    return made;
  }

  const width = (host) => Math.max(260, host.clientWidth || host.parentElement.clientWidth);

  function timeline(data, host) {
    for (const bus of data.overview.buses.slice(0, MOST_BUSES)) {
      const line = bus.line, x = positions(line, bus.axis), name = data.overview.buses.length > 1 ? Model.visible(bus.bus) + ": " : "";
      if (line.busy_us) plot(host, name + "load", bus.axis, "%", x, [["load %", line.busy_us.map((busy) => (100 * busy) / line.step), { steps: true }]], { height: 130 });
      else plot(host, name + "frames", bus.axis, "frames", x, [["frames", line.frames, { steps: true }]], { height: 130, decimals: 0 });
      plot(host, name + "failures", bus.axis, "count", x, [["failed", line.failed, { bars: true, colour: "bad" }],
        ["exceptions", line.exceptions, { bars: true, colour: "odd" }]], { height: 110, decimals: 0 });
      if (line.silence_us) plot(host, name + "longest silence", bus.axis, "ms", x, [["ms", line.silence_us.map((us) => us / 1000 || null), { steps: true, gaps: true }]], { height: 110, decimals: 3 });
    }
    said(host, data.overview.buses.length - MOST_BUSES, "more buses have no plot here");
    said(host, data.overview.left_out.buses, "more buses have no course over time in the document");
  }

  function said(host, count, text) {
    if (count > 0) host.append(el("p", { class: "hint" }, `${Model.fixed(count, 0)} ${text}.`));
  }

  function damage(data, host) {
    for (const bus of data.overview.buses.slice(0, MOST_BUSES)) {
      const line = bus.line, name = data.overview.buses.length > 1 ? Model.visible(bus.bus) + ": " : "";
      plot(host, name + "damage and noise", bus.axis, "", positions(line, bus.axis), [["damaged frames", line.damaged, { bars: true, colour: "bad" }],
        ["bytes of noise", line.noise_bytes, { bars: true, colour: "odd" }]], { height: 120, decimals: 0 });
    }
  }

  // Counts of a histogram whose buckets are edges_us[i] to edges_us[i + 1].
  function responseTimes(data, host) {
    const rows = Model.rowsAt(data, "statistics.buses[].units[]").filter((row) => row.response_time);
    if (!rows.length) return void host.append(el("p", { class: "hint" }, "No response time was measured."));
    const many = data.statistics.buses.length > 1, select = el("select", { id: "response-of" });
    rows.forEach((row, at) => select.append(el("option", { value: String(at) },
      `${many ? Model.visible(row.bus) + ", " : ""}unit ${row.unit}, function ${row.function} ${Model.visible(data.functions[row.function] || "")}`)));
    const worst = rows.reduce((worst, row, at) => (row.response_time.p95_us > rows[worst].response_time.p95_us ? at : worst), 0);
    select.value = String(worst);
    const place = el("div", {});
    host.append(el("div", { class: "tools" }, el("label", {}, "Response times of ", select)), place);
    const draw = () => {
      forget(place);
      const row = rows[Number(select.value)], bus = data.overview.buses.find((one) => one.bus === row.bus);
      const reserve = data.doctor.reserves.find((one) => one.bus === row.bus && one.unit === row.unit);
      const { edges_us: edges, counts } = row.response_time.histogram;
      const middles = counts.map((_, at) => Math.sqrt(edges[at] * edges[at + 1]) / 1000);
      plot(place, "distribution", null, "responses", middles, [["responses", counts, { bars: true }]],
        { logarithmic: true, decimals: 0, height: 140, xLabel: "ms" });
      const found = bus?.requests.rows.find((one) => one.unit === row.unit && one.function === row.function)?.response_time;
      if (!found) return;
      const ms = (values) => values.map((us) => (us === null ? null : us / 1000));
      const series = [["longest", ms(found.max_us), { width: 1 }], ["shortest", ms(found.min_us), { width: 1 }], ["mean", ms(found.mean_us), { width: 2 }]];
      if (found.p95_us) series.push(["p95", ms(found.p95_us), { width: 1.5 }]);
      if (reserve?.timeout_us) series.push(["timeout", found.min_us.map(() => reserve.timeout_us / 1000), { dash: [6, 4], colour: "bad" }]);
      plot(place, "over time", bus.axis, "ms", positions(bus.requests.steps, bus.axis), series, { bands: [[1, 2]], height: 180, decimals: 3 });
    };
    select.addEventListener("change", draw);
    draw();
  }

  function registers(data, host) {
    const rows = Model.rowsAt(data, "overview.buses[].registers.rows[]"), place = el("div", {});
    const chosen = new Set(rows.map((row, at) => (row.course ? at : -1)).filter((at) => at >= 0).slice(0, 3));
    host.append(place);
    const draw = () => {
      forget(place);
      if (!chosen.size) return void place.append(el("p", { class: "hint" }, "Choose values in the table to see them here."));
      for (const bus of data.overview.buses) {
        const own = [...chosen].filter((at) => rows[at].bus === bus.bus);
        if (!own.length) continue;
        const title = own.map((at) => label(rows[at])).join(", ");
        plot(place, title, bus.axis, "", positions(bus.registers.steps, bus.axis),
          own.map((at) => [label(rows[at]), rows[at].course.last, {}]), { fromZero: false, height: 220, decimals: 3 });
      }
    };
    return { rows, chosen, draw };
  }

  const label = (row) => Model.visible(row.name || `unit ${row.unit} ${row.register_type} ${row.address}`).replaceAll("_", " ");

  // The cells of a table that are drawn: the row's data, and a canvas.
  function cells(id, title, count, draw) {
    const table = document.querySelector(`#${id} > .scroll > table`);
    if (!table) return;
    const column = [...table.tHead.rows[0].cells].findIndex((one) => one.textContent === title);
    const found = [...table.tBodies[0].rows].slice(0, count);
    if (column >= 0) found.forEach((row, at) => draw(row.cells[column], at));
  }

  function strip(cell, name, paint) {
    const canvas = el("canvas", { class: "strip", role: "img", "aria-label": name });
    cell.replaceChildren(canvas);
    drawn.push({ canvas, paint, host: cell });
  }

  // All strips: first all are measured, then all are painted. One after the other, each would lay out the page anew.
  function paintStrips() {
    const strips = drawn.filter((one) => one.canvas), ratio = window.devicePixelRatio || 1;
    const boxes = strips.map((one) => one.canvas.getBoundingClientRect());
    strips.forEach(({ canvas, paint }, at) => {
      canvas.width = Math.max(1, boxes[at].width * ratio);
      canvas.height = Math.max(1, boxes[at].height * ratio);
      paint(canvas.getContext("2d"), canvas.width, canvas.height);
    });
  }

  function unitStrips(data) {
    const rows = Model.rowsAt(data, "doctor.reserves[]");
    const busOf = (row) => data.overview.buses.find((one) => one.bus === row.bus);
    cells("units", "answered over time", rows.length, (cell, at) => {
      const own = busOf(rows[at])?.requests.rows.filter((one) => one.unit === rows[at].unit) || [];
      if (own.length) strip(cell, `unit ${rows[at].unit}: answered share over time`, (to, width, height) => answered(to, width, height, own));
    });
    cells("units", "p95 over time", rows.length, (cell, at) => {
      const row = rows[at], p95 = busOf(row)?.requests.units?.find((one) => one.unit === row.unit)?.p95_us || [];
      const known = p95.filter((us) => us !== null);
      if (!known.length) return;
      const least = Math.min(...known), most = Math.max(...known), edge = row.timeout_us || most, ms = (us) => Model.fixed(us / 1000, 1);
      const name = `unit ${row.unit}: 95 % of the responses take up to ${ms(least)} to ${ms(most)} ms, ` +
        (row.timeout_us ? `the timeout is ${ms(edge)} ms` : "the timeout is not known");
      strip(cell, name, (to, width, height) => reserve(to, width, height, p95, edge, Boolean(row.timeout_us)));
    });
  }

  // Bars of a unit's requests in each bucket: answered, refused, and failed on top.
  function answered(to, width, height, own) {
    const sum = (key, number) => own.reduce((all, one) => all + one[key][number], 0);
    const count = own[0].transactions.length, step = width / count;
    for (let number = 0; number < count; number++) {
      const all = sum("transactions", number);
      if (!all) continue;
      const bad = sum("silent", number) + sum("damaged", number), refused = sum("exceptions", number);
      let from = height;
      for (const [paint, share] of [["ok", all - bad - refused], ["odd", refused], ["bad", bad]]) {
        const part = share ? Math.max((share / all) * height, 2) : 0;
        to.fillStyle = colour(paint);
        to.fillRect(number * step, from - part, Math.max(step, 1), part);
        from -= part;
      }
    }
  }

  // Bars up to the p95 in each bucket; the upper edge is the timeout, which what exceeds it hides.
  function reserve(to, width, height, p95, edge, isTimeout) {
    const step = width / p95.length;
    p95.forEach((us, number) => {
      if (us === null) return;
      const part = Math.max(Math.min(us / edge, 1) * height, 2);
      to.fillStyle = colour(isTimeout && us >= edge ? "bad" : "accent");
      to.fillRect(number * step, height - part, Math.max(step, 1), part);
    });
    to.fillStyle = colour(isTimeout ? "bad" : "dim");
    to.fillRect(0, 0, width, Math.max(1, window.devicePixelRatio || 1));
  }

  function distributions(data) {
    const rows = Model.rowsAt(data, "statistics.buses[].units[]");
    cells("response-times", "distribution", rows.length, (cell, at) => {
      const found = rows[at].response_time;
      if (!found) return;
      const most = Math.max(...found.histogram.counts), counts = found.histogram.counts;
      strip(cell, `unit ${rows[at].unit}, function ${rows[at].function}: distribution of response times`, (to, width, height) => {
        to.fillStyle = colour("accent");
        const step = Math.min(width / counts.length, width / 12);
        counts.forEach((count, bucket) => {
          const part = count ? Math.max((count / most) * height, 1) : 0;
          to.fillRect(bucket * step, height - part, Math.max(step - 1, 1), part);
        });
      });
    });
  }

  function sparklines(data, registers) {
    const { rows, chosen, draw } = registers;
    cells("registers", "over time", rows.length, (cell, at) => {
      const row = rows[at];
      if (!row.course) return void cell.replaceChildren(el("span", { class: "hint" }, "constant"));
      const made = el("td", {});
      strip(made, `${label(row)} over time`, (to, width, height) => sparkline(to, width, height, row));
      const box = el("input", { type: "checkbox", "aria-label": `plot ${label(row)}` });
      box.checked = chosen.has(at);
      box.addEventListener("change", () => {
        if (box.checked && chosen.size === MOST_TOGETHER) {
          box.checked = false;
          return Report.say(`${MOST_TOGETHER} at most are plotted together.`);
        }
        if (box.checked) chosen.add(at);
        else chosen.delete(at);
        draw();
      });
      cell.replaceChildren(box, ...made.childNodes);
    });
    draw();
  }

  function sparkline(to, width, height, row) {
    const { min, max, last } = row.course, least = row.min, span = row.max - row.min || 1;
    const y = (value) => height - 2 - ((value - least) / span) * (height - 4), step = width / min.length;
    to.fillStyle = colour("line");
    min.forEach((low, at) => low !== null && to.fillRect(at * step, y(max[at]), Math.max(step, 1), Math.max(y(low) - y(max[at]), 1)));
    to.strokeStyle = colour("accent");
    to.lineWidth = Math.max(1, window.devicePixelRatio || 1);
    to.beginPath();
    let begun = false;
    last.forEach((value, at) => {
      if (value === null) return;
      to[begun ? "lineTo" : "moveTo"]((at + 0.5) * step, y(value));
      begun = true;
    });
    to.stroke();
  }

  function forget(host) {
    for (const one of drawn) if (one.plot && host.contains(one.host)) one.plot.destroy();
    drawn = drawn.filter((one) => !host.contains(one.host));
    host.replaceChildren();
  }

  function redraw() {
    colours = {};
    paintStrips();
    for (const one of drawn) if (one.plot) one.plot.redraw(false, true);
  }

  function resize() {
    for (const one of drawn) if (one.plot) one.plot.setSize({ width: width(one.host), height: one.plot.height });
    redraw();
  }

  function all(data) {
    drawn = [];
    colours = {};
    const host = (name) => document.querySelector(`[data-plot="${name}"]`);
    for (const name of ["timeline", "response-times", "registers", "damage"]) host(name).replaceChildren();
    unitStrips(data);
    timeline(data, host("timeline"));
    responseTimes(data, host("response-times"));
    distributions(data);
    sparklines(data, registers(data, host("registers")));
    damage(data, host("damage"));
    paintStrips();
  }

  // What the plots with an axis show of it.
  const ranges = () => drawn.filter((one) => one.axis).map(({ plot }) => [plot.scales.x.min, plot.scales.x.max]);

  return { all, redraw, resize, ranges };
})();
