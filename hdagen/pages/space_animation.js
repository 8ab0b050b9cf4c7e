// The arm in space moving: play, pause, scrub; drag to turn. A place is [x, y, z] with z up, m.

const startSpaceArm = (figure, data) => {
  const time = floats(data.time, data.start), arm = floats(data.points), joints = data.names.length;
  const begin = time[0], length = time[time.length - 1] - begin, self = { figure };
  const triples = (packed) => Array.from({ length: packed.length / 3 }, (_, at) => packed.subarray(3 * at, 3 * at + 3));
  const still = data.still.map((packed) => triples(floats(packed)));
  const rows = () => [
    ["time (s)", ...data.names.flatMap((name) => ["x", "y", "z"].map((axis) => `${name} ${axis} (m)`))],
    ...[...time].map((moment, at) => [moment, ...arm.subarray(3 * joints * at, 3 * joints * (at + 1))]),
  ];
  tools(figure, rows);

  let [turn, tilt] = data.camera;
  const views = drawings(figure).map((svg) => {
    const [middle, scale, width, height] = [data.middle, ...pair(svg.querySelector(".view").dataset.view)];
    const place = (at) => { // as space_animation.py projects
      const [x, y, z] = [0, 1, 2].map((axis) => at[axis] - middle[axis]);
      const right = -Math.sin(turn) * x + Math.cos(turn) * y, away = Math.cos(turn) * x + Math.sin(turn) * y;
      const up = Math.cos(tilt) * z - Math.sin(tilt) * away;
      return [(width / 2 + scale * right).toFixed(1), (height / 2 - scale * up).toFixed(1)];
    };
    const all = (name) => [...svg.querySelectorAll(name)];
    return { svg, place, still: all(".fixed"), live: all(".live")[0], names: all(".live text") };
  });
  const line = (places) => (places.length ? "M" + places.map((at) => at.join(" ")).join("L") : "");
  const dots = (places) => places.map(([x, y]) => `M${x} ${y}h.01`).join("");
  const pose = (moment) => {
    if (time.length < 2) return triples(arm.subarray(0, 3 * joints));
    const [next, share] = shareBetween(time, moment);
    const mix = (at) => (1 - share) * arm[3 * joints * (next - 1) + at] + share * arm[3 * joints * next + at];
    return Array.from({ length: joints }, (_, joint) => [0, 1, 2].map((axis) => mix(3 * joint + axis)));
  };
  const draw = (moment) => {
    const now = pose(moment);
    for (const { svg, place, still: fixed, live, names } of views) {
      if (!svg.getClientRects().length) continue;
      fixed.forEach((path) => path.setAttribute("d", line(still[path.dataset.at].map(place))));
      const places = now.map(place);
      live.querySelector(".shadow").setAttribute("d", line(now.map(([x, y]) => place([x, y, data.floor]))));
      live.querySelector(".links").setAttribute("d", line(places));
      live.querySelector(".joints").setAttribute("d", dots(places));
      live.querySelector(".marked").setAttribute("d", dots(data.marked.map((at) => places[at])));
      names.forEach((text, at) => {
        const [x, y] = places[data.marked[at]];
        text.setAttribute("x", Number(x) + 14);
        text.setAttribute("y", Number(y) - 10);
      });
    }
  };
  let moment = () => begin;
  if (time.length > 1) moment = addPlayer(self, begin, length, data.seconds, [], draw);

  const look = (by, over) => {
    turn -= by;
    tilt = Math.min(Math.max(tilt + over, -Math.PI / 2), Math.PI / 2);
    figure.classList.add("moving");
    draw(moment());
  };
  for (const { svg } of views) {
    let from = null;
    svg.classList.add("turns");
    svg.setAttribute("tabindex", 0);
    svg.addEventListener("pointerdown", (event) => {
      from = inside(svg, event);
      svg.setPointerCapture(event.pointerId);
    });
    svg.addEventListener("pointermove", (event) => {
      if (!from) return;
      const to = inside(svg, event);
      look((to[0] - from[0]) / 120, (to[1] - from[1]) / 120);
      from = to;
    });
    for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => { from = null; });
    svg.addEventListener("keydown", ({ key }) => {
      const ways = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
      if (ways[key]) look(...ways[key]);
    });
  }
  return self;
};
starts.space_arm = startSpaceArm;
