// Marks of a score in groups, a mark a method: shape and place tell methods apart without colour.
function conditionChart(section, score, found, groups, counts, at) {
  const scale = score.unit === "share" ? 100 : 1;
  const values = groups.flatMap((row) => section.methods.map((_, method) => scale * at(row, method)));
  const axis = valueAxis(score, values.filter(Number.isFinite));
  const endless = values.some((value) => value === Infinity);
  const [left, right, height, foot] = [62, 10, 200, 74];
  const top = endless ? 44 : 12;
  const step = Math.max(86, 14 + 9 * section.methods.length);
  const width = left + step * groups.length + right;
  const y = (value) => (value === Infinity ? 20 : top + height * (1 - axis.share(value)));
  const node = svg("svg", { viewBox: `0 0 ${width} ${height + foot + top}`, width, class: "chart", role: "img",
    "aria-label": `${heading(score)} by ${found.title}${axis.log ? ", logarithmic" : ""}; the numbers are in the table below` });
  for (const value of axis.ticks) {
    node.append(svg("line", { x1: left, x2: width - right, y1: y(value), y2: y(value), class: "rule" }),
      label(left - 6, y(value) + 4, String(Number(value.toPrecision(3))), "end"));
  }
  if (endless) {
    node.append(svg("rect", { x: left, y: 6, width: width - right - left, height: 28, class: "endless" }), label(left - 6, 24, "infinite", "end"));
  }
  const name = label(0, 0, `${heading(score)}${axis.log ? ", log" : ""}`, "middle");
  name.setAttribute("transform", `translate(14 ${top + height / 2}) rotate(-90)`);
  node.append(name, label(left + (step * groups.length) / 2, top + height + 62, `${found.title}; n: queries`, "middle"));
  groups.forEach((row, place) => {
    const middle = left + step * (place + 0.5);
    if (place) node.append(svg("line", { x1: middle - step / 2, x2: middle - step / 2, y1: 6, y2: top + height, class: "rule" }));
    node.append(label(middle, top + height + 22, shorten(row.label), "middle"), label(middle, top + height + 39, `n = ${counts[row.index]}`, "middle"));
    section.methods.forEach((method, number) => {
      const value = scale * at(row, number);
      if (Number.isNaN(value)) return;
      const x = middle + (section.methods.length === 1 ? 0 : (number / (section.methods.length - 1) - 0.5) * (step - 24));
      const mark = svg("path", { d: shape(number, x, y(value)), fill: COLOURS[number % COLOURS.length], class: "mark" });
      mark.append(svg("title", {}, `${method.name}, ${row.label}: ${shown(score, at(row, number))}`));
      node.append(mark);
    });
  });
  return el("div", {}, el("div", { class: "chart-box", tabindex: "0", role: "group", "aria-label": "Chart" }, node), chartLegend(section));
}

// From zero up, or by powers of ten where errors span decades.
function valueAxis(score, values) {
  const [low, high] = [Math.min(...values), Math.max(...values)];
  if (spansDecades(score, values)) {
    const [first, last] = [Math.floor(Math.log10(low)), Math.ceil(Math.log10(high))];
    const factors = last - first > 3 ? [1] : [1, 2, 5];
    const ticks = [];
    for (let power = first; power < last; power += 1) ticks.push(...factors.map((factor) => factor * 10 ** power));
    return { log: true, ticks: [...ticks, 10 ** last], share: (value) => (Math.log10(value) - first) / (last - first) };
  }
  const top = roundUp(Math.max(...values, 1e-9));
  return { log: false, ticks: values.length ? [0, 1, 2, 3, 4].map((part) => (top * part) / 4) : [], share: (value) => value / top };
}

// The least of 1, 2, 4, 5, 8 and 10 times a power of ten that is no less.
function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 2, 4, 5, 8, 10].find((factor) => factor * power >= value * 0.999999);
}

function label(x, y, text, anchor) {
  return svg("text", { x, y, "text-anchor": anchor, "font-size": 12, fill: "currentColor" }, text);
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
