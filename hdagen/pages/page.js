// Starts the figures of the page. One whose data cannot be read stays the picture it is.

const started = [];
const everyLinked = (self, action) => { // self and all figures of its link
  const link = self.figure.dataset.link;
  started.filter((one) => one === self || (link && one.figure.dataset.link === link)).forEach(action);
};
starts.dots = starts.table = (figure, data) => {
  tools(figure, () => data.rows);
  if (data.searchable) searchTable(figure, data.rows.slice(1));
  return { figure };
};
for (const block of document.querySelectorAll(".command pre")) {
  const copy = button("Copy", "Copy the command", async () => {
    getSelection().selectAllChildren(block); // so that a key copies it where the page may not
    await navigator.clipboard.writeText(block.textContent);
    copy.textContent = "Copied";
    setTimeout(() => { copy.textContent = "Copy"; }, 1500);
  });
  block.after(copy);
}

for (const figure of document.querySelectorAll("figure[data-kind]")) {
  try {
    const data = JSON.parse(figure.querySelector("script").textContent);
    started.push(starts[figure.dataset.kind](figure, data));
  } catch (problem) {
    console.info(`The figure "${figure.getAttribute("aria-label")}" stays still: ${problem.message}`);
  }
}
