const page = JSON.parse(document.getElementById("page-data").textContent);
const ARRAYS = { "<u1": Uint8Array, "<u2": Uint16Array, "<i2": Int16Array, "<i4": Int32Array };
const COLLATOR = new Intl.Collator("en", { numeric: true });
const SPOKEN = { best: " (best)", tied: " (cannot be told from the best)" };
const unpacked = new Map();
const drawn = []; // promises of what is drawn late

// Makes an element. Texts become text nodes: nothing in the data is ever read as HTML.
function el(tag, attributes, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes || {})) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value === true) node.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(name, value);
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return node;
}

function svg(tag, attributes, ...children) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

// JSON has no infinite numbers and no NaN: they are "inf" and null.
function number(value) {
  if (value === null || value === undefined) return NaN;
  return value === "inf" ? Infinity : value === "-inf" ? -Infinity : value;
}

// A light tint of a cell, as strong as Python says: print and black text stay readable.
function tinted(strength) {
  return strength ? `rgba(0, 114, 178, ${strength})` : "";
}

// For screen readers alone.
function spoken(text) {
  return el("span", { class: "sr" }, text);
}

// Fetches what a blob holds, once.
function unpack(packed) {
  if (!unpacked.has(packed.blob)) unpacked.set(packed.blob, inflate(packed));
  return unpacked.get(packed.blob);
}

async function inflate(packed) {
  const holder = document.getElementById(`blob-${packed.blob}`);
  const bytes = Uint8Array.from(atob(holder.textContent), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer();
  if (packed.type === "json") return JSON.parse(new TextDecoder().decode(buffer));
  return new ARRAYS[packed.type](buffer);
}

function option(value, text, selected) {
  return el("option", { value: String(value), selected: Boolean(selected) }, text);
}

function choice(label, options, onchange) {
  const select = el("select", { onchange: () => onchange(select.value) });
  select.append(...options.map(([value, text]) => option(value, text)));
  return { node: el("label", {}, label, select), select };
}

function tick(label, checked, onchange) {
  const box = el("input", { type: "checkbox", checked, onchange: () => onchange(box.checked) });
  return { node: el("label", { class: "tick" }, box, label), box };
}

function field(label, type, oninput) {
  const input = el("input", { type, oninput: () => oninput(input.value), autocomplete: "off" });
  return { node: el("label", {}, label, input), input };
}

// Orders values; those that are missing stand last, whichever way.
function compare(one, other, descending) {
  const [first, second] = [missing(one), missing(other)];
  if (first || second) return first - second;
  const order = typeof one === "string" ? COLLATOR.compare(one, other) : one < other ? -1 : one > other ? 1 : 0;
  return descending ? -order : order;
}

function missing(value) {
  return value === null || value === undefined || Number.isNaN(value);
}

// A table whose columns sort. A column has a title, value(row) to sort by, show(row), and
// perhaps bestFirst, "descending" or "ascending", and a hint; the first one heads its rows.
// `none` is said where no row is left.
function sortableTable(caption, columns, rows, none = "nothing matches") {
  const state = { column: null, descending: false, rows };
  const body = el("tbody", {});
  const heads = columns.map((column, index) =>
    el("th", { scope: "col", class: column.text ? "text" : null, "aria-sort": "none" },
      el("button", { type: "button", class: column.title.length > 16 ? "long" : null, title: column.hint ? `${column.title}: ${column.hint}` : column.title, onclick: () => sortBy(index) }, column.title)));
  const node = el("div", { class: "scroll" },
    el("table", { class: columns.length > 10 ? "many" : null }, el("caption", {}, el("span", {}, caption)), el("thead", {}, el("tr", {}, heads)), body));

  function sortBy(index) {
    const first = columns[index].bestFirst === "descending";
    state.descending = state.column === index ? !state.descending : first;
    state.column = index;
    heads.forEach((head, place) => head.setAttribute("aria-sort",
      place !== index ? "none" : state.descending ? "descending" : "ascending"));
    draw();
  }

  function draw() {
    const sorted = [...state.rows];
    if (state.column !== null) {
      const value = columns[state.column].value;
      sorted.sort((one, other) => Boolean(one.floor) - Boolean(other.floor) || compare(value(one), value(other), state.descending));
    }
    body.replaceChildren(...sorted.map((row) => el("tr", { class: row.floor ? "floor" : null }, columns.map((column, index) => cell(column, row, index)))));
    if (!sorted.length) body.append(el("tr", { class: "none" }, el("td", { class: "text", colspan: columns.length }, none)));
  }

  function cell(column, row, index) {
    const content = column.show(row);
    const mark = column.mark ? column.mark(row) : "";
    const made = el(index === 0 ? "th" : "td",
      { scope: index === 0 ? "row" : null, class: [column.text ? "text" : "", column.wide ? "wide" : "", mark].join(" ").trim() || null },
      content, mark ? spoken(SPOKEN[mark]) : null);
    if (column.tint) made.style.backgroundColor = column.tint(row);
    return made;
  }

  draw();
  return { node, rows, update(newRows) { state.rows = newRows; draw(); } };
}

function panel(section, name, title, ...children) {
  return el("section", { class: "panel", id: `${section.id}-${name}`, "aria-labelledby": `${section.id}-${name}-h` },
    el("h3", { id: `${section.id}-${name}-h`, tabindex: "-1" }, title), ...children);
}

function goTo(section, name) {
  const target = document.getElementById(`${section.id}-${name}-h`);
  if (target) reveal(target, target, "start");
}

// Moves the focus, for keyboards and screen readers, and the page no further than it must.
function reveal(node, focused, block = "nearest") {
  node.scrollIntoView({ block });
  focused.focus({ preventScroll: true });
}

// A box that is opened and closed: Escape closes it too.
function drillBox(id, title, close, ...children) {
  const head = el("h4", { tabindex: "-1" }, title);
  const box = el("div", { class: "drill", id, onkeydown: (event) => {
    if (event.key !== "Escape") return;
    event.stopPropagation();
    close();
  } }, head, ...children);
  return { box, head };
}

// Folded where the page is narrow; where it is wide the fold is not seen.
function narrowFolded(title, ...children) {
  const narrow = matchMedia("(max-width: 30rem)");
  const node = el("details", { class: "narrow", open: !narrow.matches }, el("summary", {}, title), ...children);
  narrow.addEventListener("change", () => { node.open = !narrow.matches; });
  return node;
}

// Unfolds what is long.
function folded(count, most, title, node) {
  return count > most ? el("details", {}, el("summary", {}, title), node) : node;
}
