// A table whose rows can be searched by any word and sorted by any column; empty cells stay last.

const searchTable = (figure, values) => {
  const body = figure.querySelector("tbody"), rows = [...body.rows];
  const words = rows.map((row) => row.textContent.toLowerCase());
  const count = make("output", {});
  const field = make("input", { type: "search", placeholder: "search", title: "Show the rows that have all these words" });
  field.setAttribute("aria-label", "Search the rows");
  field.addEventListener("input", () => {
    const wanted = field.value.toLowerCase().split(" ").filter(Boolean);
    let shown = 0;
    rows.forEach((row, k) => {
      row.hidden = !wanted.every((word) => words[k].includes(word));
      shown += !row.hidden;
    });
    count.textContent = wanted.length ? `${shown} of ${rows.length}` : "";
  });
  figure.querySelector(".tools").prepend(count, field);

  const order = (column, down) => (a, b) => {
    const [x, y] = [values[a][column], values[b][column]];
    if (x === null || y === null) return (x === null) - (y === null) || a - b;
    const ahead = typeof x === "string" ? x.localeCompare(String(y), undefined, { numeric: true }) : x - y;
    return (down ? -ahead : ahead) || a - b;
  };
  const heads = [...figure.querySelectorAll("thead th")];
  heads.forEach((head, column) => {
    const sort = () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      body.append(...rows.map((_, k) => k).sort(order(column, down)).map((k) => rows[k]));
    };
    head.replaceChildren(button(head.textContent, "Sort by this column", sort));
  });
};
