// Play, pause, scrub: the row under a figure that moves. spans are [from, to] of what the rail marks.

const addPlayer = (self, begin, length, seconds, spans, draw) => {
  const { figure } = self;
  const play = button("\u25b6 Play", "Play or pause", () => (running ? stop() : start()));
  const rail = make("input", { type: "range", min: begin, max: begin + length, step: length / 1e4, value: begin });
  const told = make("output", { textContent: `${begin.toFixed(2)} s` });
  const speed = make("select", { title: "Speed" }, ...[0.1, 0.25, 0.5, 1, 2, 4].map((rate) =>
    make("option", { value: rate, textContent: `\u00d7 ${rate}`, selected: rate === 1 })));
  speed.setAttribute("aria-label", "Speed");
  rail.setAttribute("aria-label", "Time");
  const marks = spans.map(([from, to]) => {
    const mark = make("i", { title: "push" });
    mark.style.left = `${(100 * (from - begin)) / length}%`;
    mark.style.width = `${(100 * (to - from)) / length}%`;
    return mark;
  });
  figure.querySelector(".drawing").after(
    make("div", { className: "player" }, play, make("div", { className: "rail" }, rail, ...marks), told, speed));

  let moment = begin, running = 0, before = 0;
  const show = (to) => {
    moment = to;
    figure.classList.add("moving");
    draw(to);
    rail.value = to;
    told.textContent = `${to.toFixed(2)} s`;
  };
  const step = (now) => {
    moment += ((now - before) / 1000) * Number(speed.value) * (length / Math.max(seconds, 1e-3));
    before = now;
    if (moment >= begin + length) stop();
    else running = requestAnimationFrame(step);
    go(Math.min(moment, begin + length));
  };
  const go = (to) => {
    show(to);
    everyLinked(self, (one) => one !== self && one.point?.(to));
  };
  const start = () => {
    if (moment >= begin + length) moment = begin;
    before = performance.now();
    running = requestAnimationFrame(step);
    play.textContent = "\u275a\u275a Pause";
  };
  const stop = () => {
    cancelAnimationFrame(running);
    running = 0;
    play.textContent = "\u25b6 Play";
  };
  rail.addEventListener("input", () => { stop(); go(Number(rail.value)); });
  new ResizeObserver(() => figure.classList.contains("moving") && draw(moment)).observe(figure);
  self.point = (to) => {
    if (!running && to >= begin && to <= begin + length) show(to);
  };
  return () => moment;
};

const shareBetween = (time, moment) => { // the frame after a moment, and its share between the two about the moment
  const next = Math.min(Math.max(below(time, moment), 1), time.length - 1), step = time[next] - time[next - 1];
  return [next, step > 0 ? Math.min(Math.max((moment - time[next - 1]) / step, 0), 1) : 1];
};
