// A plot with axes, a legend that has values at rest, and its figures as a table. Colours come from the style sheet.
const Charts = (() => {
  const FIGURES = 120, PAPER = 700, LOW = 0.68, FEW = 40;
  // Told apart with red-green blindness (Okabe and Ito), and by their dashes without colours.
  const LINES = [["one", []], ["two", [7, 3]], ["three", [2, 3]], ["four", [10, 3, 2, 3]], ["five", [14, 4]], ["six", [4, 6]], ["seven", [1, 2]], ["eight", [12, 3, 2, 3, 2, 3]]];
  const el = Show.el;
  let drawn = [], paper = false;

  // Looked up once for each time that all is drawn: to ask costs more than to paint.
  let colours = {};
  const colour = (name) => (colours[name] ??= getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim());

  const scaleOf = (axis) => (axis === "transactions" ? 1 : 1e-6);
  const edges = (steps, axis) => [steps.start * scaleOf(axis), (steps.start + steps.count * steps.step) * scaleOf(axis)];

  // The middle of each bucket: seconds, or numbers of transactions.
  const positions = (steps, axis) =>
    Array.from({ length: steps.count }, (_, at) => (steps.start + (at + 0.5) * steps.step) * scaleOf(axis));

  const iso = (seconds) => new Date(Math.floor(seconds) * 1000).toISOString();

  // Times of day; the date stands at midnight and beside the axis.
  function clock(plot, stamps, axis, space, step) {
    const digits = step < 0.001 ? 6 : step < 1 ? 3 : 0;
    return stamps.map((at) => {
      const text = iso(at), time = text.slice(11, step < 60 ? 19 : 16) + (digits ? (at - Math.floor(at)).toFixed(digits).slice(1) : "");
      return step >= 86400 || (step >= 60 && time === "00:00") ? text.slice(5, 10) : time;
    });
  }

  function when(seconds, axis, step) {
    if (axis === "transactions") return Show.fixed(seconds, 0);
    if (axis !== "utc") return Show.fixed(seconds, step < 1 ? 3 : 0) + " s";
    return iso(seconds).replace("T", " ").slice(0, 19) + (step < 1 ? (seconds - Math.floor(seconds)).toFixed(3).slice(1) : "");
  }

  function labelOf(axis, [from, to]) {
    const days = [iso(from).slice(0, 10), iso(to).slice(0, 10)];
    return axis === "utc" ? (days[0] === days[1] ? days[0] : days.join(" to ")) : { relative: "seconds from the start", transactions: "number of the transaction" }[axis];
  }

  function axes({ axis, unit, span, label, whole }) {
    const common = { stroke: () => colour("dim"), grid: { stroke: () => colour("line"), width: 1 }, ticks: { stroke: () => colour("line") } };
    const numbers = (plot, ticks) => ticks.map((one) => (one === null ? "" : one.toLocaleString("en-US", { maximumFractionDigits: 6 })));
    return [
      { ...common, label: label || labelOf(axis, span), labelSize: 18, size: 34, space: (plot) => (plot.scales.x.max - plot.scales.x.min < 30 ? 95 : 80), values: axis === "utc" ? clock : label ? numbers : undefined },
      { ...common, label: Show.visible(unit), labelSize: 18, size: 60, space: () => (paper ? 14 : 22), values: numbers, ...(whole ? { incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1e3, 2e3, 5e3, 1e4, 1e5, 1e6, 1e7] } : {}) },
    ];
  }

  function line({ name, colour: named, draw, width, rest, decimals, few }, at) {
    const [own, dash] = LINES[at % LINES.length], bars = draw === "bars";
    const paint = () => colour(named ? (bars ? `strip-${named}` : named) : own);
    return {
      label: name, stroke: paint, width: bars ? 0 : width ?? 1.5, fill: bars ? paint : undefined, dash: bars || !at ? undefined : dash,
      points: { show: !bars && few, size: 5, fill: paint }, spanGaps: false, paths: bars ? uPlot.paths.bars({ size: [0.92, 90, 1] }) : undefined,
      value: (_, value) => (value === null || value === undefined ? rest : Show.fixed(value, decimals)),
    };
  }

  // How a series is summed up while the pointer is elsewhere.
  function atRest(values, decimals, whole) {
    const known = values.filter((one) => one !== null && one !== undefined);
    if (!known.length) return "none";
    if (whole) return `${Show.fixed(known.reduce((sum, one) => sum + one, 0), 0)} in all`;
    const ends = [Math.min(...known), Math.max(...known)].map((one) => Show.fixed(one, decimals));
    return ends[0] === ends[1] ? ends[0] : `${ends[0]} to ${ends[1]}`;
  }

  const decimalsOf = (values) => {
    const most = Math.max(0, ...values.map((one) => Math.abs(one || 0)));
    return most >= 100 ? 0 : most >= 10 ? 1 : most >= 1 ? 2 : 3;
  };

  // One plot over time: {title, axis, unit, steps, series: [{name, values, colour, draw, width}], bands, whole, fromZero}.
  // Zooming one zooms all with the same axis.
  function overTime(host, given) {
    const { axis, steps } = given, span = edges(steps, axis), x = positions(steps, axis);
    const scale = { time: axis === "utc", range: (_, from, to) => (from === x[0] && to === x.at(-1) ? span : [from, to]) };
    const [first, last] = span.map((at) => when(at, axis, steps.step * scaleOf(axis)));
    const rest = `${first} to ${axis === "utc" && first.slice(0, 10) === last.slice(0, 10) ? last.slice(11) : last}`;
    const shown = (_, value) => (value === null ? rest : when(value, axis, steps.step * scaleOf(axis)));
    return chart(host, { ...given, span, x, scale, xSeries: { label: axis === "transactions" ? "transaction" : "time", value: shown } });
  }

  function chart(host, { title, axis, unit, x, scale, span, xSeries, label, series, bands, whole, fromZero = true, height = 150 }) {
    const box = el("div", { role: "group", "aria-label": title }), place = el("div", {});
    box.append(el("h3", {}, title), place);
    host.append(box);
    const decimals = whole ? 0 : decimalsOf(series.flatMap((one) => one.values));
    const lines = series.map((one, at) => line({ ...one, decimals, few: x.length <= FEW, rest: one.rest ?? atRest(one.values, decimals, whole) }, at));
    const plot = new uPlot({
      width: widthOf(host), height, pxAlign: 0,
      tzDate: (stamp) => uPlot.tzDate(new Date(stamp * 1000), "Etc/UTC"),
      scales: { x: scale, y: { range: (_, least, most) => range(least, most, fromZero) } },
      axes: axes({ axis, unit, span, label, whole }), series: [xSeries, ...lines],
      bands: (bands || []).map((pair) => ({ series: pair, fill: () => colour("band") })),
      cursor: { drag: { x: Boolean(axis), y: false }, sync: axis ? { key: axis } : undefined },
      hooks: { setScale: [(one, key) => key === "x" && zoomed(one, axis)] },
    }, [x, ...series.map((one) => one.values)], place);
    const canvas = plot.over.parentElement.querySelector("canvas");
    canvas.setAttribute("aria-label", `${title}: a plot; its figures are in the table below`);
    canvas.setAttribute("role", "img");
    const entry = { plot, host, axis, span, height, label: plot.axes[0].label, isReady: false };
    drawn.push(entry);
    // Until then its scale is its own, and nobody has zoomed.
    setTimeout(() => { entry.isReady = true; });
    box.append(figures(plot, title, series.map(({ name }) => name)));
    return plot;
  }

  function range(least, most, fromZero) {
    if (least === null || most === null) return [0, 1];
    if (fromZero) return [Math.min(0, least), most > 0 ? most * 1.08 : 1];
    return least === most ? [least - 1, most + 1] : [least - (most - least) * 0.05, most + (most - least) * 0.05];
  }

  let zooming = false;
  function zoomed(from, axis) {
    const own = drawn.find((one) => one.plot === from && one.isReady);
    if (zooming || !axis || !own) return;
    zooming = true;
    const { min, max } = from.scales.x, isWhole = min === own.span[0] && max === own.span[1];
    for (const one of drawn) {
      const [from, to] = isWhole ? one.span : [min, max];
      if (one !== own && one.axis === axis) one.plot.setScale("x", { min: from, max: to });
    }
    zooming = false;
  }

  // The figures of a plot as a table, made when somebody opens it.
  function figures(one, title, names) {
    const made = el("details", { class: "figures" }, el("summary", {}, "Figures"));
    made.addEventListener("toggle", () => {
      if (!made.open) return;
      made.querySelector(".scroll")?.remove();
      const [x, ...columns] = one.data, { min, max } = one.scales.x, rows = [];
      x.forEach((at, number) => {
        if (at >= min && at <= max && columns.some((column) => column[number]) && rows.length < FIGURES)
          rows.push(el("tr", {}, el("td", {}, one.series[0].value(one, at)),
            ...columns.map((column, which) => el("td", { class: "n" }, column[number] === null ? "" : one.series[which + 1].value(one, column[number])))));
      });
      const head = el("tr", {}, ...[one.series[0].label, ...names].map((name) => el("th", { scope: "col" }, name)));
      made.append(el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": `Figures of ${title}` },
        el("table", {}, el("thead", {}, head), el("tbody", {}, ...rows))));
    });
    return made;
  }

  const widthOf = (host) => (paper ? PAPER : Math.max(260, host.clientWidth || host.parentElement.clientWidth));

  function forget(host) {
    for (const one of drawn) if (host.contains(one.host)) one.plot.destroy();
    drawn = drawn.filter((one) => !host.contains(one.host));
    host.replaceChildren();
  }

  function redraw() {
    colours = {};
    for (const one of drawn) one.plot.redraw(false, true);
  }

  // Paper leaves the date to the legend: the figures of the scale need its room.
  function resize(onPaper) {
    paper = onPaper;
    for (const one of drawn) {
      one.plot.axes[0].label = paper && one.axis === "utc" ? null : one.label;
      one.plot.setSize({ width: widthOf(one.host), height: paper ? one.height * LOW : one.height });
    }
    redraw();
  }

  function reset() {
    drawn = [];
    colours = {};
  }

  // What the plots with an axis show of it.
  const ranges = () => drawn.filter((one) => one.axis).map(({ plot }) => [plot.scales.x.min, plot.scales.x.max]);

  // The figures beside each plot.
  const scales = () => drawn.map(({ plot }) => plot.axes[1]._values.filter(Boolean));

  return { overTime, chart, colour, forget, redraw, resize, reset, ranges, scales };
})();
