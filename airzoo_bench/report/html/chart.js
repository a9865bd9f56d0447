// Marks of a score in groups, a mark a method: shape and place tell methods apart without colour.
// Heights, 0 to 1, and the ticks of the axis come with the view; here they become pixels.
function conditionChart(section, score, found, groups, counts, view) {
  const endless = groups.some((row) => view.heights.some((heights) => number(heights[row.index]) === Infinity));
  const [left, right, height, foot] = [62, 10, 200, 74];
  const top = endless ? 44 : 12;
  const step = Math.max(86, 14 + 9 * section.methods.length);
  const width = left + step * groups.length + right;
  const y = (share) => (share === Infinity ? 20 : top + height * (1 - share));
  const node = svg("svg", { viewBox: `0 0 ${width} ${height + foot + top}`, width, class: "chart", role: "img",
    "aria-label": `${score.heading} by ${found.title}${view.log ? ", logarithmic" : ""}; the numbers are in the table below` });
  for (const [share, text] of view.ticks) {
    node.append(svg("line", { x1: left, x2: width - right, y1: y(share), y2: y(share), class: "rule" }), label(left - 6, y(share) + 4, text, "end"));
  }
  if (endless) {
    node.append(svg("rect", { x: left, y: 6, width: width - right - left, height: 28, class: "endless" }), label(left - 6, 24, "infinite", "end"));
  }
  const name = label(0, 0, `${score.heading}${view.log ? ", log" : ""}`, "middle");
  name.setAttribute("transform", `translate(14 ${top + height / 2}) rotate(-90)`);
  node.append(name, label(left + (step * groups.length) / 2, top + height + 62, `${found.title}; n: queries`, "middle"));
  groups.forEach((row, place) => {
    const middle = left + step * (place + 0.5);
    if (place) node.append(svg("line", { x1: middle - step / 2, x2: middle - step / 2, y1: 6, y2: top + height, class: "rule" }));
    node.append(label(middle, top + height + 22, shorten(row.label), "middle"), label(middle, top + height + 39, `n = ${counts[row.index]}`, "middle"));
    section.methods.forEach((method, index) => {
      const share = number(view.heights[index][row.index]);
      if (Number.isNaN(share)) return;
      const x = middle + (section.methods.length === 1 ? 0 : (index / (section.methods.length - 1) - 0.5) * (step - 24));
      const mark = markOf(method, x, y(share));
      mark.append(svg("title", {}, `${method.name}, ${row.label}: ${view.texts[index][row.index]}`));
      node.append(mark);
    });
  });
  return el("div", {}, el("div", { class: "chart-box", tabindex: "0", role: "group", "aria-label": "Chart" }, node), chartLegend(section));
}

function label(x, y, text, anchor) {
  return svg("text", { x, y, "text-anchor": anchor, "font-size": 12, fill: "currentColor" }, text);
}

function shorten(text) {
  return text.length > 14 ? `${text.slice(0, 13)}…` : text;
}

function markOf(method, x, y) {
  return svg("path", { d: method.marker.path, transform: `translate(${x} ${y})`, fill: method.marker.colour, class: "mark" });
}

function chartLegend(section) {
  if (section.methods.length === 1) return null;
  return el("ul", { class: "legend" }, section.methods.map((method) =>
    el("li", {}, svg("svg", { width: 16, height: 16, "aria-hidden": "true" }, markOf(method, 8, 8)), " ", method.name)));
}
