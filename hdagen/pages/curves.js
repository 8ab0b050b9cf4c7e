// Curves: values under the cursor, zoom by dragging, back by double click or Escape. Drawn anew as plot.py draws them.

// Rows of ascending xs to draw: those in sight, and of each pixel the smallest, the largest and every gap.
const rowsInSight = (xs, ys, x, pixels) => {
  const from = Math.max(0, below(xs, x.low) - 1), to = Math.min(xs.length, below(xs, x.high) + 2), kept = new Set();
  if (to - from < 4 * pixels) return Array.from({ length: to - from }, (_, at) => from + at);
  for (let row = from; row < to;) {
    const pixel = Math.floor(x.place(xs[row]));
    let least = row, most = row;
    for (; row < to && Math.floor(x.place(xs[row])) === pixel; row++) {
      if (Number.isNaN(ys[row])) kept.add(row);
      if (!(ys[least] <= ys[row])) least = row;
      if (!(ys[most] >= ys[row])) most = row;
    }
    kept.add(least).add(most);
  }
  return [...kept].sort((a, b) => a - b);
};

const pathOf = (xs, ys, rows, x, y, height, draw) => {
  let d = "", down = false;
  for (const row of rows) {
    const across = x.place(xs[row]).toFixed(1), up = (height - y.place(ys[row])).toFixed(1);
    const seen = Number.isFinite(across - up);
    if (seen && draw === "points") d += `M${across} ${up}h.01`;
    else if (seen) d += !down ? `M${across} ${up}` : draw === "step" ? `H${across}V${up}` : `L${across} ${up}`;
    down = seen;
  }
  return d;
};

const redrawScales = ({ node, w, h }, x, y) => {
  const scales = node.querySelector(".scales"), [grid, rim] = scales.querySelectorAll("path");
  const font = parseFloat(node.ownerSVGElement.getAttribute("font-size")), faint = { "fill-opacity": 0.72 };
  let lines = "";
  scales.replaceChildren(grid, rim);
  for (const [value, words] of ticks(y, Math.floor(h / 38) + 1)) {
    const at = h - y.place(value);
    lines += `M0 ${at.toFixed(1)}H${w}`;
    shape(scales, "text", { x: -7, y: at + 0.35 * font, "text-anchor": "end", ...faint }, words);
  }
  for (const [value, words] of ticks(x, Math.floor(w / 90) + 1)) {
    const at = x.place(value);
    lines += `M${at.toFixed(1)} 0V${h}`;
    if (!("words" in scales.dataset)) continue;
    shape(scales, "text", { x: at, y: h + 1.5 * font, "text-anchor": "middle", ...faint }, words);
  }
  grid.setAttribute("d", lines);
};

const redrawPlaces = ({ area, w, h }, x, y) => { // bands, levels and marks
  for (const band of area.querySelectorAll(".band")) {
    const from = x.place(Number(band.dataset.from)), to = x.place(Number(band.dataset.to));
    const box = band.querySelector("rect");
    box?.setAttribute("x", from);
    box?.setAttribute("width", Math.max(to - from, 1));
    band.querySelector("text")?.setAttribute("x", Math.max(from, 0) + 4);
    band.setAttribute("visibility", to > 0 && from < w ? "visible" : "hidden");
  }
  for (const level of area.querySelectorAll(".level")) {
    level.setAttribute("transform", `translate(0 ${h - y.place(Number(level.dataset.y))})`);
  }
  for (const { dataset, attributes } of area.querySelectorAll(".mark")) {
    attributes.transform.value = `translate(${x.place(Number(dataset.x))} ${h - y.place(Number(dataset.y))})`;
  }
};

const startCurves = (figure, data) => {
  const unpacked = []; // when first needed
  const column = (at) => (unpacked[at] ??= floats(data.columns[at].data, data.columns[at].start));
  const sheets = drawings(figure).map((svg) => ({
    svg,
    plots: [...svg.querySelectorAll(".plot")].map((node, at) => {
      const area = node.querySelector(".area"), [left, top] = origin(node);
      const home = { x: pair(node.dataset.x), y: pair(node.dataset.y) };
      const size = { w: Number(area.getAttribute("width")), h: Number(area.getAttribute("height")) };
      return { spec: data.plots[at], node, area, left, top, ...size, home, now: home };
    }),
  }));
  const plots = sheets.flatMap((sheet) => sheet.plots);
  const axes = (plot) => [axisOf(plot.spec.x, plot.now.x, plot.w), axisOf(plot.spec.y, plot.now.y, plot.h)];
  const common = data.shared && data.plots.some((plot) => plot.curves.length) ? () => column(0) : null; // x of all
  const readout = readoutOf(figure);
  const whole = Object.assign(button("Whole axis", "Show the whole axis again"), { hidden: true });

  const redraw = (plot) => {
    const [x, y] = axes(plot);
    redrawScales(plot, x, y);
    redrawPlaces(plot, x, y);
    plot.area.querySelectorAll(".trace").forEach((trace, at) => {
      const curve = plot.spec.curves[at], xs = column(curve.x), ys = column(curve.y);
      const rows = common ? rowsInSight(xs, ys, x, plot.w) : [...xs.keys()];
      trace.querySelector(".curve").setAttribute("d", pathOf(xs, ys, rows, x, y, plot.h, curve.draw));
      if (!curve.spread) return;
      const [low, high] = curve.spread.map(column);
      const full = rows.filter((row) => Number.isFinite(y.place(low[row]) + y.place(high[row])));
      const back = pathOf(xs, high, [...full].reverse(), x, y, plot.h, "line").replace("M", "L");
      trace.querySelector(".spread").setAttribute("d", pathOf(xs, low, full, x, y, plot.h, "line") + back);
    });
  };
  const fitted = ({ spec, home }, range) => { // the span of y of what is in sight, with a little to spare
    let low = Infinity, high = -Infinity;
    for (const ys of spec.curves.flatMap((curve) => [curve.y, ...(curve.spread ?? [])]).map(column)) {
      for (let row = below(common(), range[0]); row < ys.length && common()[row] <= range[1]; row++) {
        if (spec.y.log && !(ys[row] > 0)) continue;
        if (ys[row] < low) low = ys[row];
        if (ys[row] > high) high = ys[row];
      }
    }
    if (!(low <= high)) return home.y;
    if (spec.y.log) return [low / 1.2, high * 1.2];
    const flat = high - low <= 1e-9 * Math.max(Math.abs(low), Math.abs(high));
    const spare = flat ? Math.abs(high) / 2 || 1 : 0.06 * (high - low);
    return [low - spare, high + spare];
  };
  const zoom = (x, y, spec) => { // without x: back to the whole; without spec: all plots
    for (const plot of plots.filter((one) => !spec || one.spec === spec)) {
      plot.now = x ? { x, y: y ?? fitted(plot, x) } : plot.home;
      redraw(plot);
    }
    whole.hidden = plots.every((plot) => plot.now === plot.home);
  };

  const cursor = (plot, line, dots) => {
    const group = plot.area.querySelector(".cursor") ?? shape(plot.area, "g", { class: "cursor", fill: "none" });
    group.replaceChildren();
    shape(group, "path", { d: line, stroke: "currentColor", "stroke-opacity": 0.6 });
    shape(group, "path", { d: dots, stroke: "currentColor", "stroke-width": 7, "stroke-linecap": "round" });
  };
  const point = (value) => { // a line through all plots of one x; a dot on paths that know their time
    for (const plot of plots) {
      const [x, y] = axes(plot);
      const dots = plot.spec.curves.map((curve) => {
        const clock = common ? curve.x : curve.time;
        if (clock === undefined) return "";
        const row = nearest(column(clock), value);
        return pathOf(column(curve.x), column(curve.y), [row], x, y, plot.h, "points");
      });
      cursor(plot, common ? `M${x.place(value).toFixed(1)} 0V${plot.h}` : "", dots.join(""));
    }
  };
  const clear = () => {
    readout.hide();
    plots.forEach((plot) => plot.area.querySelector(".cursor")?.remove());
  };
  const self = { figure, point, clear, zoom: (x) => (common || !x) && zoom(x) };
  whole.onclick = () => everyLinked(self, (one) => one.zoom?.());

  const tellRow = (sheet, row, where) => {
    const value = common()[row], x = axes(sheet.plots[0])[0];
    const lines = sheet.plots.flatMap((plot) => {
      const y = axes(plot)[1], name = [plot.spec.heading, y.name].filter(Boolean).join(" \u00b7 ");
      const told = plot.spec.curves.map((curve) => [curve.label, written(column(curve.y)[row], y), curve.color]);
      return sheet.plots.length > 1 ? [[name, ""], ...told] : told;
    });
    everyLinked(self, (one) => one.point?.(value));
    readout.show(where, [[x.name, written(value, x)], ...lines]);
    sheet.row = row;
  };
  const tellPoint = (plot, at, up, where) => { // the nearest point of a path within 30 px
    const [x, y] = axes(plot);
    let best = null, least = 900;
    for (const curve of plot.spec.curves) {
      const xs = column(curve.x), ys = column(curve.y);
      for (let row = 0; row < xs.length; row++) {
        const far = (x.place(xs[row]) - at) ** 2 + (plot.h - y.place(ys[row]) - up) ** 2;
        if (far < least) [best, least] = [{ curve, row }, far];
      }
    }
    if (!best) return clear();
    const { curve, row } = best, xs = column(curve.x), ys = column(curve.y);
    const lines = [[curve.label, "", curve.color], [x.name, written(xs[row], x)], [y.name, written(ys[row], y)]];
    if (curve.time !== undefined) {
      everyLinked(self, (one) => one.point?.(column(curve.time)[row]));
      lines.push(["time", `${fixed(column(curve.time)[row], 3)} s`]);
    } else cursor(plot, "", pathOf(xs, ys, [row], x, y, plot.h, "points"));
    readout.show(where, lines);
  };
  const select = (plot, [left, right], [upper, lower]) => { // zoom to a box in px, of the shape of equal axes
    const [x, y] = axes(plot);
    if (common) return everyLinked(self, (one) => one.zoom?.([x.value(left), x.value(right)]));
    if (plot.spec.equal) {
      const half = Math.max(lower - upper, ((right - left) * plot.h) / plot.w) / 2, wide = (half * plot.w) / plot.h;
      const [center, middle] = [(left + right) / 2, (upper + lower) / 2];
      [left, right, upper, lower] = [center - wide, center + wide, middle - half, middle + half];
    }
    zoom([x.value(left), x.value(right)], [y.value(plot.h - lower), y.value(plot.h - upper)], plot.spec);
  };

  for (const sheet of sheets) listen(sheet, { tellRow, tellPoint, select, clear, axes, common, self });
  const rows = () => {
    const all = data.columns.map((_, at) => column(at)), longest = Math.max(0, ...all.map((values) => values.length));
    const numbers = Array.from({ length: longest }, (_, row) => all.map((values) => values[row]));
    return [data.columns.map(({ label }) => label), ...numbers];
  };
  tools(figure, rows, whole);
  return self;
};

// Pointer and keys on one drawing.
const listen = (sheet, { tellRow, tellPoint, select, clear, axes, common, self }) => {
  const { svg, plots } = sheet, clamp = (value, high) => Math.min(Math.max(value, 0), high);
  const within = (plot, x, y) => x >= plot.left && x <= plot.left + plot.w && y >= plot.top && y <= plot.top + plot.h;
  const ends = (a, b) => [Math.min(a, b), Math.max(a, b)];
  let drag = null;
  svg.classList.add("live");
  svg.addEventListener("pointerdown", (event) => {
    const [x, y] = inside(svg, event), plot = plots.find((one) => within(one, x, y));
    if (event.button !== 0 || !plot) return;
    drag = { plot, x: x - plot.left, y: y - plot.top, box: null };
    if (event.isTrusted) svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", (event) => {
    const at = inside(svg, event), plot = drag?.plot ?? plots.find((one) => within(one, ...at));
    if (!plot) return clear();
    const x = clamp(at[0] - plot.left, plot.w), y = clamp(at[1] - plot.top, plot.h);
    if (drag && (drag.box || Math.abs(x - drag.x) > 4)) {
      const [left, right] = ends(x, drag.x), [upper, lower] = common ? [0, plot.h] : ends(y, drag.y);
      drag.box?.remove();
      const size = { x: left, width: right - left, y: upper, height: lower - upper };
      drag.box = shape(plot.area, "rect", { ...size, "fill-opacity": 0.15, class: "cursor" });
      drag.to = [[left, right], [upper, lower]];
    }
    if (!common) tellPoint(plot, x, y, around(svg, event));
    else if (common().length) tellRow(sheet, nearest(common(), axes(plot)[0].value(x)), around(svg, event));
  });
  const release = (event) => {
    const { plot, box, to } = drag ?? {};
    drag = null;
    box?.remove();
    const large = box && to[0][1] - to[0][0] > 4 && to[1][1] - to[1][0] > 4;
    if (large && event.type === "pointerup") select(plot, ...to);
  };
  svg.addEventListener("pointerup", release);
  svg.addEventListener("pointercancel", release);
  svg.addEventListener("pointerleave", () => drag || everyLinked(self, (one) => one.clear?.()));
  svg.addEventListener("dblclick", () => everyLinked(self, (one) => one.zoom?.()));
  svg.tabIndex = 0;
  svg.addEventListener("keydown", (event) => {
    if (event.key === "Escape") return everyLinked(self, (one) => one.zoom?.());
    const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!way || !common?.().length) return;
    event.preventDefault();
    const xs = common(), { now, left, top } = plots[0], first = below(xs, now.x[0]);
    const last = Math.max(first, Math.min(below(xs, now.x[1]), xs.length - 1));
    const stride = event.shiftKey ? Math.ceil((last - first) / 50) : 1;
    const scale = svg.getBoundingClientRect().width / svg.viewBox.baseVal.width;
    const row = Math.min(Math.max((sheet.row ?? first) + way * stride, first), last);
    tellRow(sheet, row, [(left + axes(plots[0])[0].place(xs[row])) * scale, top * scale]);
  });
};
starts.curves = startCurves;
