// Marks of a score in groups, a mark a method: shape and place tell methods apart without colour.
function conditionChart(section, score, found, groups, counts, at) {
  const scale = score.unit === "share" ? 100 : 1;
  const values = groups.flatMap((row) => section.methods.map((_, method) => scale * at(row, method))).filter(Number.isFinite);
  const top = roundUp(Math.max(...values, 1e-9));
  const [left, right, height, foot] = [62, 10, 200, 58];
  const step = Math.max(86, 14 + 9 * section.methods.length);
  const width = left + step * groups.length + right;
  const y = (value) => 12 + height * (1 - value / top);
  const node = svg("svg", { viewBox: `0 0 ${width} ${height + foot + 12}`, width, class: "chart", role: "img",
    "aria-label": `${heading(score)} by ${found.title}; the numbers are in the table below` });
  for (let part = 0; part <= 4; part += 1) {
    const value = (top * part) / 4;
    node.append(svg("line", { x1: left, x2: width - right, y1: y(value), y2: y(value), stroke: "#d0d7de" }),
      label(left - 6, y(value) + 4, String(Number(value.toPrecision(3))), "end"));
  }
  const axis = label(0, 0, heading(score), "middle");
  axis.setAttribute("transform", `translate(14 ${12 + height / 2}) rotate(-90)`);
  node.append(axis);
  groups.forEach((row, place) => {
    const middle = left + step * (place + 0.5);
    if (place) node.append(svg("line", { x1: middle - step / 2, x2: middle - step / 2, y1: 12, y2: 12 + height, stroke: "#e7ebef" }));
    node.append(label(middle, height + 30, shorten(row.label), "middle"), label(middle, height + 47, `n = ${counts[row.index]}`, "middle"));
    section.methods.forEach((method, number) => {
      const value = scale * at(row, number);
      if (!Number.isFinite(value)) return;
      const x = middle + (section.methods.length === 1 ? 0 : (number / (section.methods.length - 1) - 0.5) * (step - 24));
      const mark = svg("path", { d: shape(number, x, y(value)), fill: COLOURS[number % COLOURS.length], stroke: "#fff", "stroke-width": 0.7 });
      mark.append(svg("title", {}, `${method.name}, ${row.label}: ${shown(score, at(row, number))}`));
      node.append(mark);
    });
  });
  return el("div", {}, el("div", { class: "chart-box", tabindex: "0", role: "group", "aria-label": "Chart" }, node), chartLegend(section));
}

// The least of 1, 2, 4, 5, 8 and 10 times a power of ten that is no less.
function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 2, 4, 5, 8, 10].find((factor) => factor * power >= value * 0.999999);
}

function label(x, y, text, anchor) {
  return svg("text", { x, y, "text-anchor": anchor, "font-size": 12, fill: "#1b1f24" }, text);
}

function shorten(text) {
  return text.length > 14 ? `${text.slice(0, 13)}…` : text;
}

function shape(number, x, y) {
  const r = 5.5;
  const kind = (number + Math.floor(number / COLOURS.length)) % 4;
  if (kind === 0) return `M${x - r},${y} a${r},${r} 0 1,0 ${2 * r},0 a${r},${r} 0 1,0 ${-2 * r},0`;
  if (kind === 1) return `M${x - r},${y - r} h${2 * r} v${2 * r} h${-2 * r}z`;
  if (kind === 2) return `M${x},${y - r} l${r},${2 * r} h${-2 * r}z`;
  return `M${x},${y - r - 1} l${r + 1},${r + 1} l${-r - 1},${r + 1} l${-r - 1},${-r - 1}z`;
}

function chartLegend(section) {
  if (section.methods.length === 1) return null;
  return el("ul", { class: "legend" }, section.methods.map((method, number) => {
    const mark = svg("svg", { width: 16, height: 16, "aria-hidden": "true" }, svg("path", { d: shape(number, 8, 8), fill: COLOURS[number % COLOURS.length] }));
    return el("li", {}, mark, " ", method.name);
  }));
}
