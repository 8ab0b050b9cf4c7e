// The arm moving: play, pause, scrub; arrows while something pushes.

const startArm = (figure, data) => {
  const time = floats(data.time, data.start), arms = data.arms.map((arm) => floats(arm.points));
  const frames = time.length, joints = data.joints, begin = time[0], length = time[frames - 1] - begin;
  const largest = Math.max(...data.pushes.map(([, , force]) => Math.hypot(...force)), 1e-12);
  const views = [...figure.querySelectorAll(".view")].map((node) => {
    const [left, low, scale, height] = pair(node.dataset.view);
    const place = ([x, y]) => [((x - left) * scale).toFixed(1), (height - (y - low) * scale).toFixed(1)];
    return { node, height, place, live: [...node.querySelectorAll(".live")], push: node.querySelector(".push") };
  });
  const self = { figure };
  const rows = () => {
    const names = data.arms.flatMap(({ label }) =>
      Array.from({ length: joints }, (_, at) => ["x", "y"].map((axis) => `${label} point ${at} ${axis} (m)`)).flat());
    const values = (at) => arms.flatMap((points) => [...points.subarray(2 * joints * at, 2 * joints * (at + 1))]);
    return [["time (s)", ...names], ...[...time].map((moment, at) => [moment, ...values(at)])];
  };
  tools(figure, rows);
  if (frames < 2 || !arms.length) return self;

  const pose = (points, moment) => { // joints at a moment, between two frames
    const [next, share] = shareBetween(time, moment);
    const number = (frame, at) => points[2 * joints * frame + at];
    const mix = (at) => (1 - share) * number(next - 1, at) + share * number(next, at);
    return Array.from({ length: joints }, (_, joint) => [mix(2 * joint), mix(2 * joint + 1)]);
  };
  const trail = (points, moment) => { // where the tip was in the last second
    const from = below(time, moment - 1), to = below(time, moment);
    return Array.from({ length: Math.max(to - from, 0) }, (_, at) => {
      const tip = 2 * (joints * (from + at + 1) - 1);
      return [points[tip], points[tip + 1]];
    });
  };
  const line = (places) => (places.length ? "M" + places.map((at) => at.join(" ")).join("L") : "");
  const showPush = ({ push, height, place }, tip, force) => { // drawn as animation.py draws it
    push.setAttribute("visibility", force ? "visible" : "hidden");
    if (!force) return;
    const size = Math.hypot(...force), reach = (data.arrow * height * size) / largest;
    const angle = Math.atan2(-force[1], force[0]);
    const arrow = push.firstChild, words = arrow.querySelector("text");
    arrow.setAttribute("transform", `translate(${place(tip).join(" ")})`);
    arrow.querySelector(".turn").setAttribute("transform", `rotate(${((angle * 180) / Math.PI).toFixed(1)})`);
    arrow.querySelector(".shaft").setAttribute("d", `M${-reach - 8} 0H-16`);
    if (!words) return;
    words.setAttribute("x", -Math.cos(angle) * (reach + 30));
    words.setAttribute("y", -Math.sin(angle) * (reach + 22) + 4);
    words.textContent = `${Number(size.toPrecision(3))} N`;
  };
  const show = (moment) => {
    const force = data.pushes.find(([from, to]) => moment >= from && moment < to)?.[2];
    const poses = arms.map((points) => pose(points, moment));
    for (const view of views) {
      if (!view.node.getClientRects().length) continue;
      view.live.forEach((group, at) => {
        const places = poses[at].map(view.place), path = trail(arms[at], moment).map(view.place);
        group.querySelector(".links").setAttribute("d", line(places));
        group.querySelector(".joints").setAttribute("d", places.map(([x, y]) => `M${x} ${y}h.01`).join(""));
        group.querySelector(".trail").setAttribute("d", line([...path, places[joints - 1]]));
      });
      showPush(view, poses[0][joints - 1], force);
    }
  };

  addPlayer(self, begin, length, data.seconds, data.pushes, show);
  return self;
};
starts.arm = startArm;
