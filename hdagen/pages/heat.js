// Heat maps: the cell under the cursor.

const startHeat = (figure, data) => {
  const cells = floats(data.cells), readout = readoutOf(figure), [across, up] = [data.x, data.y];
  const named = (edges) => typeof edges[0] === "string";
  const count = (edges) => (named(edges) ? edges.length : edges.length - 1);
  const columns = count(across), rows = count(up);
  const find = (edges, log, share) => { // the cell at a share of the axis from its low end
    if (named(edges)) return Math.min(Math.floor(share * edges.length), edges.length - 1);
    const axis = axisOf({ log }, [edges[0], edges[edges.length - 1]], 1);
    return Math.min(Math.max(below(edges, axis.value(share)) - 1, 0), edges.length - 2);
  };
  const digits = (value, [, unit, factor]) => {
    const text = String(Number((value * factor).toPrecision(4))).replace("-", "\u2212");
    return Number.isFinite(value) ? `${text} ${unit}` : "\u2013";
  };
  const range = (edges, at, how) =>
    named(edges) ? edges[at] : `${digits(edges[at], [0, "", how[2]])}\u2026 ${digits(edges[at + 1], how)}`;
  for (const svg of drawings(figure)) {
    const plot = svg.querySelector(".plot"), area = plot.querySelector(".area"), [left, top] = origin(plot);
    const w = Number(area.getAttribute("width")), h = Number(area.getAttribute("height"));
    svg.addEventListener("pointermove", (event) => {
      const [x, y] = inside(svg, event), share = [(x - left) / w, (y - top) / h];
      if (share.some((part) => part < 0 || part > 1)) return readout.hide();
      const column = find(across, data.log[0], share[0]);
      const row = find(up, data.log[1], named(up) ? share[1] : 1 - share[1]);
      readout.show(around(svg, event), [
        [data.written[0][0], range(across, column, data.written[0])],
        [data.written[1][0], range(up, row, data.written[1])],
        [data.written[2][0], digits(cells[row * columns + column], data.written[2])],
      ]);
    });
    svg.addEventListener("pointerleave", readout.hide);
  }
  const ends = (edges, at) => (named(edges) ? [edges[at]] : [edges[at], edges[at + 1]]);
  const head = (edges, label) => (named(edges) ? [label] : [`${label} from`, `${label} to`]);
  tools(figure, () => [
    [...head(across, data.labels[0]), ...head(up, data.labels[1]), data.labels[2]],
    ...[...cells.keys()].map((at) => [
      ...ends(across, at % columns), ...ends(up, Math.floor(at / columns) % rows), cells[at],
    ]),
  ]);
  return { figure };
};
starts.heat = startHeat;
