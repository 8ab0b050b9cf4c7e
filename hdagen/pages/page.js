// Starts the figures of the page. One whose data cannot be read stays the picture it is.

const started = [];
const everyLinked = (self, action) => { // self and all figures of its link
  const link = self.figure.dataset.link;
  started.filter((one) => one === self || (link && one.figure.dataset.link === link)).forEach(action);
};
const startTable = (figure, data) => {
  tools(figure, () => data.rows);
  if (data.searchable) searchTable(figure, data.rows.slice(1));
  return { figure };
};
const starts = { curves: startCurves, heat: startHeat, arm: startArm, bars: startTable, table: startTable };

for (const figure of document.querySelectorAll("figure[data-kind]")) {
  try {
    const data = JSON.parse(figure.querySelector("script").textContent);
    started.push(starts[figure.dataset.kind](figure, data));
  } catch (problem) {
    console.info(`The figure "${figure.getAttribute("aria-label")}" stays still: ${problem.message}`);
  }
}
