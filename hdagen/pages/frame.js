// What stands around a drawing: elements, buttons that save it, the box that reads out values.

const starts = {}; // what brings a figure to life, by its kind; each file adds its own

const make = (name, properties, ...children) => {
  const element = Object.assign(document.createElement(name), properties);
  element.append(...children);
  return element;
};
const shape = (parent, name, attributes, text = "") => { // an SVG element at the end of its parent
  const element = document.createElementNS(parent.namespaceURI, name);
  for (const key in attributes) element.setAttribute(key, attributes[key]);
  element.textContent = text;
  parent.append(element);
  return element;
};
const button = (text, title, onclick) => make("button", { type: "button", textContent: text, title, onclick });
const drawings = (figure) => [...figure.querySelectorAll(".drawing > svg")];
const pair = (text) => text.split(" ").map(Number);
const origin = (node) => pair(node.getAttribute("transform").slice("translate(".length, -1));
const inside = (svg, event) => { // the pointer in the drawing's own pixels
  const box = svg.getBoundingClientRect(), scale = svg.viewBox.baseVal.width / box.width;
  return [(event.clientX - box.left) * scale, (event.clientY - box.top) * scale];
};
const around = (svg, event) => { // the pointer in the pixels of the box around the drawing
  const box = svg.parentElement.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
};

const save = (figure, text, type, ending) => {
  const title = (figure.getAttribute("aria-label") || "figure").toLowerCase();
  const name = title.replace(/[^a-z0-9]+/g, "-").slice(0, 60) + ending;
  const link = make("a", { href: URL.createObjectURL(new Blob([text], { type })), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
};
const saveDrawing = (figure) => {
  const copy = drawings(figure).find((svg) => svg.getClientRects().length).cloneNode(true);
  copy.querySelectorAll(".cursor").forEach((node) => node.remove());
  copy.prepend(shape(copy, "rect", { width: "100%", height: "100%", fill: "#ffffff" }));
  save(figure, new XMLSerializer().serializeToString(copy), "image/svg+xml", ".svg");
};
const cell = (value) => {
  const digits = Math.fround(value) === value ? 8 : 13; // of what was packed in 32 bits, and of anything else
  if (typeof value === "number") return Number.isFinite(value) ? String(Number(value.toPrecision(digits))) : "";
  const text = String(value ?? "");
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
};
const saveNumbers = (figure, rows) => {
  save(figure, rows.map((row) => row.map(cell).join(",")).join("\r\n") + "\r\n", "text/csv", ".csv");
};
const tools = (figure, rows, ...more) => { // rows() gives what the CSV holds
  const bar = make("div", { className: "tools" }, ...more);
  if (drawings(figure).length) bar.append(button("SVG", "Save the drawing", () => saveDrawing(figure)));
  bar.append(button("CSV", "Save the numbers, in base units", () => saveNumbers(figure, rows())));
  figure.querySelector("h3").classList.add("beside");
  figure.append(bar);
};

const readoutOf = (figure) => { // lines are [words, value, colour]
  const box = make("div", { className: "readout", hidden: true });
  box.setAttribute("aria-live", "polite");
  figure.querySelector(".drawing").append(box);
  const line = ([words, value, color]) => make(
    "span", {}, color ? make("i", { className: `key ${color}` }) : "", `${words} `, make("b", { textContent: value }));
  return {
    hide: () => { box.hidden = true; },
    show: ([x, y], lines) => {
      box.replaceChildren(...lines.map(line));
      box.hidden = false;
      const room = box.parentElement.clientWidth, left = x + 16;
      box.style.left = `${Math.max(0, left + box.offsetWidth > room ? x - 16 - box.offsetWidth : left)}px`;
      box.style.top = `${y + 14}px`;
    },
  };
};
