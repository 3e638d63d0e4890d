// The plots of the sections: those that layout.toml describes, and those that have a function here.
const Plots = (() => {
  const MOST_BUSES = 8, MOST_ON_PAPER = 2, MOST_TOGETHER = 8, MANY = 8, LONG_US = 10e6, SMOOTH_VALUES = 4, SMOOTH_STEP = 0.25;
  const el = Show.el;

  const nameOf = (data, bus) => (data.overview.buses.length > 1 ? Show.visible(bus.bus) + ": " : "");

  // The plots of a section, for each bus.
  function* described(data, host, plots) {
    const buses = data.overview.buses.slice(0, MOST_BUSES);
    for (const [number, bus] of buses.entries()) {
      const steps = Buckets.joined(bus.line, Buckets.least(data, bus)), place = el("div", { class: number < MOST_ON_PAPER ? "" : "screen-only" });
      host.append(place);
      for (const one of plots) if (!one.only_without || !bus.line[one.only_without]) yield overTime(data, place, bus, steps, one);
    }
    if (buses.length > MOST_ON_PAPER) host.append(el("p", { class: "paper-only" }, `Plots of the first ${MOST_ON_PAPER} buses; those of the others are in the report on a screen.`));
    said(host, data.overview.buses.length - MOST_BUSES, "more buses have no plot here");
    said(host, data.overview.left_out.buses, "more buses have no time series in the document");
  }

  function overTime(data, host, bus, steps, one) {
    const known = one.series.filter(({ path }) => bus.line[path]);
    if (!known.length) return;
    const title = nameOf(data, bus) + one.title, made = known.map((series) => valuesOf(series, bus.line, steps));
    if (one.empty && !made.some(({ values }) => values.some(Boolean)))
      return void host.append(el("h3", {}, title), el("p", { class: "hint" }, one.empty));
    Charts.overTime(host, {
      title, axis: bus.axis, unit: one.unit || made[0].unit, steps, series: made, height: 120,
      whole: known.every((series) => series.as === "count"),
    });
  }

  // A described series of these buckets: count, share of the time, or the longest time.
  function valuesOf({ name, path, as, colour }, line, steps) {
    const values = Buckets.join(line[path], steps, as === "longest" ? "max" : "sum");
    if (as === "share") return { name, colour, unit: "%", values: values.map((one, at) => shareOf(one, at, steps)) };
    if (as !== "longest") return { name, colour, draw: "bars", unit: "count", values };
    const isLong = Math.max(0, ...values) >= LONG_US;
    return { name, colour, unit: isLong ? "s" : "ms", values: values.map((us) => (us ? us / (isLong ? 1e6 : 1e3) : null)) };
  }

  // The recording may begin and end inside a bucket: what share of those was used is not known.
  function shareOf(us, at, { count, step }) {
    const isCut = count > MANY && (at === 0 || at === count - 1);
    return us === null || isCut ? null : (100 * us) / step;
  }

  function said(host, count, text) {
    if (count > 0) host.append(el("p", { class: "hint" }, `${Show.fixed(count, 0)} ${text}.`));
  }

  // Counts of a histogram whose buckets are edges_us[i] to edges_us[i + 1], and the time series of one unit and function.
  function responseTimes(data, host) {
    Strips.distributions(data);
    const rows = Show.ofBuses(data.statistics.buses, (bus) => bus.units).filter((row) => row.response_time);
    if (!rows.length) return void host.append(el("p", { class: "hint" }, "No response time was measured."));
    const many = data.statistics.buses.length > 1, select = el("select", { id: "response-of" });
    const called = (row) => `${many ? Show.visible(row.bus) + ", " : ""}unit ${row.unit}, function ${row.function} ${Show.visible(data.functions[row.function] || "")}`;
    rows.forEach((row, at) => select.append(el("option", { value: String(at) }, called(row))));
    select.value = String(rows.reduce((worst, row, at) => (row.response_time.p95_us > rows[worst].response_time.p95_us ? at : worst), 0));
    const place = el("div", {});
    host.append(el("div", { class: "tools" }, el("label", {}, "Response times of ", select)), place);
    const draw = () => {
      Charts.forget(place);
      const row = rows[Number(select.value)];
      distribution(place, row, called(row));
      responsesOverTime(data, place, row, called(row));
    };
    select.addEventListener("change", draw);
    draw();
  }

  function distribution(place, row, name) {
    const { edges_us: edges, counts } = row.response_time.histogram;
    const x = counts.map((_, at) => Math.sqrt(edges[at] * edges[at + 1]) / 1000), span = [edges[0] / 1000, edges.at(-1) / 1000];
    const shown = (_, value) => (value === null ? span.map((one) => Show.milliseconds(one * 1000)).join(" to ") : Show.milliseconds(value * 1000));
    Charts.chart(place, {
      title: `distribution: ${name}`, axis: null, unit: "count", x, span, label: "ms", whole: true, height: 140,
      scale: { time: false, distr: 3 }, xSeries: { label: "ms", value: shown }, series: [{ name: "responses", values: counts, draw: "bars" }],
    });
  }

  function responsesOverTime(data, place, row, name) {
    const bus = data.overview.buses.find((one) => one.bus === row.bus);
    const found = bus?.requests.rows.find((one) => one.unit === row.unit && one.function === row.function)?.response_time;
    if (!found) return;
    const limit = data.doctor.reserves.find((one) => one.bus === row.bus && one.unit === row.unit)?.timeout_us;
    const steps = Buckets.joined(bus.requests.steps, Buckets.least(data, bus));
    const ms = (values, how) => Buckets.join(values, steps, how).map((us) => (us === null ? null : us / 1000));
    const series = [{ name: "longest", values: ms(found.max_us, "max"), width: 1 }, { name: "shortest", values: ms(found.min_us, "min"), width: 1 }];
    if (found.p95_us) series.push({ name: "p95", values: ms(found.p95_us, "max"), width: 2 });
    // A timeout far above all responses would press them to the bottom: then the legend alone names it.
    const most = Math.max(0, ...series[0].values), isNear = limit && limit / 1000 < most * 20;
    if (limit) series.push({ name: "timeout", values: series[0].values.map(() => (isNear ? limit / 1000 : null)), colour: "bad", rest: Show.milliseconds(limit) });
    Charts.overTime(place, { title: `over time: ${name}`, axis: bus.axis, unit: "ms", steps, series, bands: [[1, 2]], height: 180 });
  }

  const label = (row) => Show.visible(row.name || `unit ${row.unit} ${row.register_type} ${row.address}`).replaceAll("_", " ");

  // Whether a value moves in steps that are small against its range. Halves of a float, bits and counters of a second do not.
  function isSmooth(values) {
    const known = values.filter((one) => one !== null), span = Math.max(...known) - Math.min(...known);
    const moved = known.slice(1).reduce((sum, one, at) => sum + Math.abs(one - known[at]), 0);
    return known.length > SMOOTH_VALUES && moved / (known.length - 1) < SMOOTH_STEP * span;
  }

  // The chosen registers: one plot for those of a bus with the same unit of measure.
  function registers(data, host) {
    const rows = Show.ofBuses(data.overview.buses, (bus) => bus.registers.rows), place = el("div", {});
    const varying = rows.map((row, at) => (row.course ? at : -1)).filter((at) => at >= 0);
    const named = varying.filter((at) => rows[at].name), smooth = varying.filter((at) => isSmooth(rows[at].course.last));
    const chosen = new Set((named.length ? named : smooth).slice(0, 3));
    host.append(place);
    const draw = () => {
      Charts.forget(place);
      if (!chosen.size && varying.length) place.append(el("p", { class: "hint" }, "Choose values in the table to see them here."));
      for (const bus of data.overview.buses) {
        const groups = new Map();
        for (const at of [...chosen].filter((at) => rows[at].bus === bus.bus)) {
          const unit = rows[at].unit_of_measure || "";
          groups.set(unit, [...(groups.get(unit) || []), rows[at]]);
        }
        for (const [unit, own] of groups) together(data, place, bus, Show.visible(unit), own);
      }
    };
    choices(rows, chosen, draw);
    draw();
  }

  function together(data, place, bus, unit, own) {
    const steps = Buckets.joined(bus.registers.steps, Buckets.least(data, bus));
    const series = own.map((row) => ({ name: label(row), values: Buckets.join(row.course.last, steps, "last") }));
    Charts.overTime(place, { title: own.map(label).join(", "), axis: bus.axis, unit, steps, series, fromZero: false, height: 180 });
  }

  function choices(rows, chosen, draw) {
    Strips.cells("registers", "over time", rows.length, (cell, at) => {
      const row = rows[at];
      if (!row.course) return void cell.replaceChildren(el("span", { class: "hint" }, "constant"));
      const made = el("td", {}), box = el("input", { type: "checkbox", "aria-label": `plot ${label(row)}` });
      Strips.sparkline(made, `${label(row)} over time`, row);
      box.checked = chosen.has(at);
      box.addEventListener("change", () => {
        if (box.checked && chosen.size === MOST_TOGETHER) {
          box.checked = false;
          return Show.say(`${MOST_TOGETHER} at most are plotted together.`);
        }
        if (box.checked) chosen.add(at);
        else chosen.delete(at);
        draw();
      });
      cell.replaceChildren(box, ...made.childNodes);
    });
  }

  const DRAWN = { responseTimes, registers };

  // Draws all, a plot or a section at each step: for who has to do something else between two of them.
  function* inTurn(data, layout) {
    Charts.reset();
    Strips.reset();
    Strips.units(data);
    for (const section of layout.section) {
      const host = document.querySelector(`[data-plot="${section.id}"]`);
      if (!host) continue;
      host.replaceChildren();
      if (section.draw) yield DRAWN[section.draw](data, host);
      else yield* described(data, host, section.plots);
    }
    Strips.paint();
  }

  function all(data, layout) {
    for (const step of inTurn(data, layout)) void step;
  }

  function redraw() {
    Charts.redraw();
    Strips.paint();
  }

  function resize(onPaper = false) {
    Charts.resize(onPaper);
    Strips.paint();
  }

  return { all, inTurn, redraw, resize, ranges: Charts.ranges };
})();
