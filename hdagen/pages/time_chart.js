// Channels over one time axis, drawn by uPlot: one cursor and one zoom for all of them.

const CHART_HEIGHT = 88, FIRST_GAP = 6, LAST_AXIS = 26;
const unpackQuantized = ({ low, step, data }, factor = 1) => {
  const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  return Array.from({ length: bytes.length >> 1 }, (_, at) => {
    const steps = view.getUint16(2 * at, true);
    return steps === 65535 ? null : (low + steps * step) * factor;
  });
};

const startTimeChart = (figure, data) => {
  const times = data.clocks.map((text) => Array.from(floats(text)));
  const night = matchMedia("screen and (prefers-color-scheme: dark)");
  const box = figure.querySelector(".drawing"), charts = [];
  const ink = (share) => (night.matches ? `rgba(232,234,237,${share})` : `rgba(27,31,36,${share})`);
  const colorOf = (label) => () => data.lines[label][night.matches ? 1 : 0];
  const font = "12px system-ui, 'Segoe UI', 'Liberation Sans', Arial, sans-serif";
  let showsErrors = true;

  const columnsOf = (channel) => { // labels, values and unit of what is shown
    const [first] = channel.errors;
    if (showsErrors) {
      const values = channel.errors.map((column) => unpackQuantized(column, first.factor));
      return { labels: channel.models, values, unit: first.unit };
    }
    const { factor, unit } = channel.measured, measured = unpackQuantized(channel.measured, factor);
    const models = channel.errors.map((column) => {
      const errors = unpackQuantized(column, factor);
      return measured.map((value, row) => (value === null || errors[row] === null ? null : value - errors[row]));
    });
    return { labels: ["measured", ...channel.models], values: [measured, ...models], unit };
  };
  const numerals = (chart, splits) => {
    const step = splits.length > 1 ? Math.abs(splits[1] - splits[0]) : 1;
    return splits.map((value) => fixed(value, decimalsOf(step)));
  };
  const shade = (chart) => {
    const { left, top, width, height } = chart.bbox;
    chart.ctx.save();
    chart.ctx.fillStyle = ink(0.09);
    for (const [from, to] of data.bands) {
      const ends = [from, to].map((value) => Math.min(Math.max(chart.valToPos(value, "x", true), left), left + width));
      chart.ctx.fillRect(ends[0], top, ends[1] - ends[0], height);
    }
    chart.ctx.restore();
  };
  const axis = (more) => ({ stroke: () => ink(0.75), font, grid: { stroke: () => ink(0.13), width: 1 },
    ticks: { show: false }, ...more });
  const build = (channel, at) => {
    const { labels, values, unit } = columnsOf(channel), last = at === data.channels.length - 1;
    const head = make("p", { className: "channel" },
      make("b", { textContent: `${channel.name}${showsErrors ? ", error" : ""} (${unit})` }), " ");
    const room = make("div", {});
    box.append(head, room);
    const line = (label) => ({
      label, stroke: colorOf(label), width: label === "measured" ? 3 : 1.4, points: { show: false },
      dash: data.lines[label][2] ? [5, 3] : undefined,
      value: (chart, value) => (value === null ? "\u2013" : `${fixed(value, decimalsOf(spanOf(values) / 500))} ${unit}`),
    });
    const below = axis({ size: last ? LAST_AXIS : FIRST_GAP, label: last ? "time (s)" : undefined, labelSize: 16, labelGap: 0,
      labelFont: font,
      values: last ? numerals : (chart, splits) => splits.map(() => "") });
    const chart = new uPlot({
      width: Math.max(box.clientWidth, 120), height: CHART_HEIGHT + (last ? LAST_AXIS + 16 : FIRST_GAP),
      padding: [6, 8, 0, 0],
      scales: { x: { time: false } },
      series: [{ label: "time", value: (_, value) => (value === null ? "" : `${fixed(value + data.start, 3)} s`) },
        ...labels.map(line)],
      axes: [below, axis({ size: 52, space: 16, values: numerals })],
      cursor: { sync: { key: figure.getAttribute("aria-label"), scales: ["x", null] }, y: false, drag: { x: true, y: false } },
      legend: { mount: (_, table) => head.append(table) },
      hooks: { drawClear: [shade] },
    }, [times[channel.clock], ...values], room);
    charts.push(chart);
  };
  const spanOf = (columns) => {
    let low = Infinity, high = -Infinity;
    for (const value of columns.flat()) if (value !== null) [low, high] = [Math.min(low, value), Math.max(high, value)];
    return high > low ? high - low : 1;
  };
  const draw = () => {
    charts.splice(0).forEach((chart) => chart.destroy());
    box.replaceChildren();
    data.channels.forEach(build);
  };
  draw();
  night.addEventListener("change", () => charts.forEach((chart) => chart.redraw(false)));
  new ResizeObserver(() => charts.forEach((chart) => {
    const width = Math.max(box.clientWidth, 120);
    if (width !== chart.width) chart.setSize({ width, height: chart.height });
  })).observe(box);
  const other = button("Measured and model", "Show the signals in place of their errors", () => {
    showsErrors = !showsErrors;
    other.textContent = showsErrors ? "Measured and model" : "Errors";
    draw();
  });
  const rows = () => {
    const columns = data.channels.flatMap((channel) => [
      [`${channel.name}: time (s)`, ...times[channel.clock].map((value) => value + data.start)],
      [`${channel.name}: measured (${channel.measured.base})`, ...unpackQuantized(channel.measured)],
      ...channel.models.map((label, at) =>
        [`${channel.name}: error ${label} (${channel.measured.base})`, ...unpackQuantized(channel.errors[at])]),
    ]);
    const longest = Math.max(0, ...columns.map((column) => column.length));
    return Array.from({ length: longest }, (_, row) => columns.map((column) => column[row] ?? ""));
  };
  tools(figure, rows, other);
  return { figure };
};
starts.time = startTimeChart;
