// What the parts of the script share: elements, data, and the movement of canvases.
const page = JSON.parse(document.getElementById("page-data").textContent);
const ARRAYS = { "<u1": Uint8Array, "<u2": Uint16Array, "<i2": Int16Array, "<i4": Int32Array };
const COLLATOR = new Intl.Collator("en", { numeric: true });
const unpacked = new Map();

// Makes an element. Texts become text nodes: nothing in the data is ever read as HTML.
function el(tag, attributes, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes || {})) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value !== null && value !== undefined) node.setAttribute(name, value);
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return node;
}

// Returns what a blob holds, unpacked once.
function unpack(packed) {
  if (!unpacked.has(packed.blob)) unpacked.set(packed.blob, inflate(packed));
  return unpacked.get(packed.blob);
}

async function inflate(packed) {
  const text = document.getElementById(`blob-${packed.blob}`).textContent;
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer();
  if (packed.type === "json") return JSON.parse(new TextDecoder().decode(buffer));
  return new ARRAYS[packed.type](buffer);
}

// Marks what is wider than its place, so that its edge fades where more is hidden.
function fading(box) {
  const look = () => {
    box.classList.toggle("cut", box.scrollLeft + box.clientWidth < box.scrollWidth - 2);
  };
  box.addEventListener("scroll", look);
  new ResizeObserver(look).observe(box);
  if (box.firstElementChild) new ResizeObserver(look).observe(box.firstElementChild);
}

// Numbers by a number of columns, texts otherwise; what is missing stands last either way.
function compare(one, other, descending) {
  if (one === null || other === null) return (one === null) - (other === null);
  const order = typeof one === "string" ? COLLATOR.compare(one, other) : one - other || 0;
  return descending ? -order : order;
}

function choice(label, options, onchange) {
  const select = el("select", { onchange: () => onchange(select.value), autocomplete: "off" });
  options.forEach(([value, text]) => select.append(el("option", { value: String(value) }, text)));
  return { node: el("label", {}, label, " ", select), select };
}

function button(name, act) {
  return el("button", { type: "button", onclick: act }, name);
}

// Calls draw whenever a canvas is shown or changes its size, with its width and height.
function fitted(canvas, draw) {
  new ResizeObserver(() => {
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * ratio);
    canvas.height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width) draw();
  }).observe(canvas);
}

// Moves by pointer, keys and wheel: drag(dx, dy), zoom(factor, x, y), and click(x, y).
function movable(canvas, { drag, zoom, click, keys = {} }) {
  canvas.addEventListener("pointerdown", (event) => {
    let [x, y] = [event.clientX, event.clientY];
    let far = 0;
    const move = (moved) => {
      far += Math.hypot(moved.clientX - x, moved.clientY - y);
      drag(moved.clientX - x, moved.clientY - y);
      [x, y] = [moved.clientX, moved.clientY];
    };
    const release = (end) => {
      window.removeEventListener("pointermove", move);
      window.removeEventListener("pointerup", release);
      window.removeEventListener("pointercancel", release);
      if (end.type === "pointerup" && far < 4 && click) click(event.offsetX, event.offsetY);
    };
    window.addEventListener("pointermove", move);
    window.addEventListener("pointerup", release);
    window.addEventListener("pointercancel", release);
  });
  // The wheel zooms only where the canvas was chosen, so that it never holds up the page.
  canvas.addEventListener(
    "wheel",
    (event) => {
      if (document.activeElement !== canvas && !event.ctrlKey) return;
      event.preventDefault();
      zoom(event.deltaY < 0 ? 1.2 : 1 / 1.2, event.offsetX, event.offsetY);
    },
    { passive: false },
  );
  const acts = {
    ArrowLeft: () => drag(60, 0),
    ArrowRight: () => drag(-60, 0),
    ArrowUp: () => drag(0, 60),
    ArrowDown: () => drag(0, -60),
    "+": () => zoom(1.5),
    "=": () => zoom(1.5),
    "-": () => zoom(1 / 1.5),
    ...keys,
  };
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !(event.key in acts)) return;
    event.preventDefault();
    acts[event.key]();
  });
}
