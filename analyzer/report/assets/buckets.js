// Buckets of a series for a plot: neighbours are joined until none is shorter than a poll cycle.
const Buckets = (() => {
  const FEW = 4, MANY = 64, CYCLES = 8;

  // The least width of a bucket on this bus, in the unit of its axis.
  function least(data, bus) {
    const found = data.statistics.buses.find((one) => one.bus === bus.bus), polls = found?.polls?.requests || [];
    if (bus.axis === "transactions") return found?.cycle?.requests || polls.length;
    // Several cycles where there is room: one more or less in a bucket then changes little.
    if (found?.cycle) return Math.max(found.cycle.p50_us, Math.min(CYCLES * found.cycle.p50_us, found.duration_us / MANY));
    // Without a cycle: each request was sent once, or none at all.
    return (found?.duration_us || 0) / (polls.length ? FEW : MANY);
  }

  // The steps of the joined buckets; both kinds begin at multiples of their width.
  function joined(steps, width) {
    let factor = 1;
    while (steps.count && steps.step * factor < width && factor < steps.count) factor *= 2;
    const first = Math.round(steps.start / steps.step), lead = ((first % factor) + factor) % factor;
    return {
      step: steps.step * factor, start: (first - lead) * steps.step, factor, lead,
      count: Math.ceil((steps.count + lead) / factor),
    };
  }

  // The values of the joined buckets; null where no bucket has one.
  function join(values, { factor, lead, count }, how) {
    if (factor === 1) return values;
    return Array.from({ length: count }, (_, at) => {
      const from = Math.max(at * factor - lead, 0), own = [];
      for (let one = from; one < Math.min((at + 1) * factor - lead, values.length); one++)
        if (values[one] !== null && values[one] !== undefined) own.push(values[one]);
      return own.length ? HOW[how](own) : null;
    });
  }

  const HOW = {
    sum: (own) => own.reduce((sum, one) => sum + one, 0),
    max: (own) => Math.max(...own),
    min: (own) => Math.min(...own),
    last: (own) => own.at(-1),
  };

  return { least, joined, join };
})();
