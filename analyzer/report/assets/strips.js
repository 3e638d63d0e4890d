// The small drawings in the cells of tables: stripes over time, distributions, sparklines.
const Strips = (() => {
  const el = Show.el, colour = Charts.colour;
  let drawn = [];

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
    drawn.push({ canvas, paint });
  }

  // All strips: first all are measured, then all are painted. One after the other, each would lay out the page again.
  function paint() {
    const ratio = window.devicePixelRatio || 1, boxes = drawn.map((one) => one.canvas.getBoundingClientRect());
    drawn.forEach(({ canvas, paint }, at) => {
      canvas.width = Math.max(1, boxes[at].width * ratio);
      canvas.height = Math.max(1, boxes[at].height * ratio);
      paint(canvas.getContext("2d"), canvas.width, canvas.height);
    });
  }

  // A rectangle on whole pixels: no seams between neighbours.
  function bar(to, name, at, count, width, top, height) {
    const left = Math.round((at * width) / count), right = Math.round(((at + 1) * width) / count);
    to.fillStyle = colour(name);
    to.fillRect(left, Math.round(top), Math.max(right - left, 1), Math.max(Math.round(height), 1));
  }

  function units(data) {
    const rows = data.doctor.reserves;
    const busOf = (row) => data.overview.buses.find((one) => one.bus === row.bus);
    const stepsOf = (bus) => Buckets.joined(bus.requests.steps, Buckets.least(data, bus));
    cells("units", "answered over time", rows.length, (cell, at) => {
      const bus = busOf(rows[at]), own = bus?.requests.rows.filter((one) => one.unit === rows[at].unit) || [];
      if (own.length) strip(cell, `unit ${rows[at].unit}: answered share over time`, (to, width, height) => answered(to, width, height, own, stepsOf(bus)));
    });
    cells("units", "p95 over time", rows.length, (cell, at) => {
      const row = rows[at], bus = busOf(row), found = bus?.requests.units?.find((one) => one.unit === row.unit)?.p95_us || [];
      const p95 = bus ? Buckets.join(found, stepsOf(bus), "max") : [], known = p95.filter((us) => us !== null);
      if (!known.length) return;
      const least = Math.min(...known), most = Math.max(...known), edge = row.timeout_us || most, ms = (us) => Show.fixed(us / 1000, 1);
      const name = `unit ${row.unit}: 95 % of the responses take up to ${ms(least)} to ${ms(most)} ms, ` +
        (row.timeout_us ? `the timeout is ${ms(edge)} ms` : "the timeout is not known");
      strip(cell, name, (to, width, height) => margin(to, width, height, p95, edge, Boolean(row.timeout_us)));
    });
  }

  // Bars of a unit's requests in each bucket: answered, refused, and failed on top.
  function answered(to, width, height, own, steps) {
    const of = (key) => Buckets.join(own[0][key].map((_, number) => own.reduce((sum, one) => sum + one[key][number], 0)), steps, "sum");
    const all = of("transactions"), silent = of("silent"), damaged = of("damaged"), refused = of("exceptions");
    all.forEach((count, number) => {
      if (!count) return;
      const bad = silent[number] + damaged[number];
      let from = height;
      for (const [name, share] of [["strip-ok", count - bad - refused[number]], ["strip-odd", refused[number]], ["strip-bad", bad]]) {
        const part = share ? Math.max((share / count) * height, 2) : 0;
        if (part) bar(to, name, number, all.length, width, Math.max(from - part, 0), part);
        from -= part;
      }
    });
  }

  // Bars up to the p95 in each bucket; the upper edge is the timeout, which what exceeds it hides.
  function margin(to, width, height, p95, edge, isTimeout) {
    p95.forEach((us, number) => {
      if (us === null) return;
      const part = Math.max(Math.min(us / edge, 1) * height, 2);
      bar(to, isTimeout && us >= edge ? "strip-bad" : "accent", number, p95.length, width, height - part, part);
    });
    to.fillStyle = colour(isTimeout ? "strip-bad" : "dim");
    to.fillRect(0, 0, width, Math.max(2, 2 * (window.devicePixelRatio || 1)));
  }

  function distributions(data) {
    const rows = Show.ofBuses(data.statistics.buses, (bus) => bus.units);
    cells("response-times", "distribution", rows.length, (cell, at) => {
      const counts = rows[at].response_time?.histogram.counts;
      if (!counts) return;
      const most = Math.max(...counts), places = Math.max(counts.length, 12);
      strip(cell, `unit ${rows[at].unit}, function ${rows[at].function}: distribution of response times`, (to, width, height) => {
        counts.forEach((count, bucket) => count && bar(to, "accent", bucket, places, width, height - Math.max((count / most) * height, 1), (count / most) * height));
      });
    });
  }

  function sparkline(cell, name, row) {
    strip(cell, name, (to, width, height) => {
      const { min, max, last } = row.course, span = row.max - row.min || 1;
      const y = (value) => height - 2 - ((value - row.min) / span) * (height - 4), step = width / min.length;
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
    });
  }

  function reset() {
    drawn = [];
  }

  return { cells, units, distributions, sparkline, paint, reset };
})();
