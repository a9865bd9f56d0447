// Compares two methods by what was computed when the page was made; the address names them.
const data = JSON.parse(document.getElementById("data").textContent);
const ARRAYS = { "<u1": Uint8Array, "<u2": Uint16Array, "<i2": Int16Array, "<i4": Int32Array };
const unpacked = new Map();
const [first, second] = ["a", "b"].map((id) => document.getElementById(id));

// Makes an element. Texts become text nodes: nothing in the data is ever read as HTML.
function el(tag, attributes, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) if (value !== null) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

function line(kind, x1, x2, y1 = 6, y2 = 6) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", "line");
  for (const [name, value] of Object.entries({ class: kind, x1, x2, y1, y2 })) node.setAttribute(name, value);
  return node;
}

async function codesOf(packed) {
  if (!unpacked.has(packed.blob)) {
    const bytes = Uint8Array.from(atob(document.getElementById(`blob-${packed.blob}`).textContent), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    unpacked.set(packed.blob, new ARRAYS[packed.type](await new Response(stream).arrayBuffer()));
  }
  return unpacked.get(packed.blob);
}

// JSON has no infinite numbers and no NaN: they are "inf" and null.
const number = (value) => (value === null || value === undefined ? NaN : value === "inf" ? Infinity : value === "-inf" ? -Infinity : value);

function shown(value, share, signed = false) {
  if (Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "inf" : "−inf";
  const text = Math.abs(share ? 100 * value : value).toFixed(2);
  if (Number(text) === 0) return text;
  return (value < 0 ? "−" : signed ? "+" : "") + text;
}

const shownP = (p) => (Number.isNaN(p) ? "–" : p < 0.00005 ? "< 0.0001" : p.toFixed(4));

// What is known of two methods by one score, as the difference of the first to the second.
async function pairOf(score, a, b) {
  const [i, j] = [a, b].map((id) => score.ids.indexOf(id));
  const [less, more] = [Math.min(i, j), Math.max(i, j)];
  const place = less * (2 * score.ids.length - less - 1) / 2 + more - less - 1;
  const found = {};
  for (const key of ["low", "high", "p", "p_holm"]) found[key] = number(score[key].values[(await codesOf(score[key].codes))[place]]);
  if (i > j) [found.low, found.high] = [-found.high, -found.low];
  const [one, other] = [number(score.values[i]), number(score.values[j])];
  return { ...found, one, other, difference: one - other };
}

function verdict(score, pair) {
  if (Number.isNaN(pair.p_holm)) return "no test";
  if (pair.p_holm > 0.05) return "cannot be told apart";
  return (pair.difference > 0) === score.higher ? "A is better" : "B is better";
}

// The interval of a difference on a line with zero in its middle.
function picture(score, pair) {
  const most = Math.max(...[pair.low, pair.high, pair.difference].map(Math.abs).filter(Number.isFinite), 1e-9);
  const at = (value) => Math.round((48 + 44 * value / most) * 10) / 10;
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  for (const [name, value] of Object.entries({ width: 96, height: 12, viewBox: "0 0 96 12", "aria-hidden": "true" })) svg.setAttribute(name, value);
  svg.append(line("axis", 4, 92), line("zero", 48, 48, 1, 11));
  if (Number.isFinite(pair.low + pair.high)) svg.append(line("whisker", at(pair.low), at(pair.high)));
  if (Number.isFinite(pair.difference)) svg.append(line("point", at(pair.difference) - 3, at(pair.difference) + 3));
  return svg;
}

const cell = (text, kind = "num") => el("td", { class: kind }, text);
const head = (text) => el("th", { scope: "row", class: "t stick" }, text);

async function overall(a, b) {
  return Promise.all(data.scores.map(async (score) => {
    const pair = await pairOf(score, a.id, b.id);
    const interval = Number.isNaN(pair.low) ? "–" : `${shown(pair.low, score.share, true)} to ${shown(pair.high, score.share, true)}`;
    return el("tr", {}, head(`${score.title} [${score.unit}]`), cell(shown(pair.one, score.share)), cell(shown(pair.other, score.share)),
      cell(shown(pair.difference, score.share, true)), cell(interval), cell(picture(score, pair), "t"),
      cell(shownP(pair.p)), cell(shownP(pair.p_holm)), cell(verdict(score, pair), "verdict"));
  }));
}

function byScene(score, a, b) {
  return data.scenes.map((title, place) => {
    const values = score.scenes[place];
    const [one, other] = [a, b].map((method) => number(values[data.methods.indexOf(method)]));
    return el("tr", {}, head(title), cell(shown(one, score.share)), cell(shown(other, score.share)), cell(shown(one - other, score.share, true)));
  });
}

async function draw() {
  const [a, b] = [first, second].map((select) => data.methods[select.selectedIndex]);
  for (const [id, method] of [["name-a", a], ["name-b", b]]) {
    const link = document.getElementById(id);
    link.firstElementChild.textContent = method.name;
    link.setAttribute("href", `methods/${method.id}.html`);
  }
  const command = document.getElementById("command");
  command.hidden = !a.run || !b.run;
  command.lastElementChild.textContent = `airzoo-bench compare ${a.run} ${b.run} --scene ${data.scene}`;
  const same = a === b;
  document.getElementById("found").hidden = same;
  const said = document.getElementById("said");
  if (same) {
    said.textContent = "Choose two different methods.";
    return;
  }
  document.querySelector("#overall tbody").replaceChildren(...await overall(a, b));
  const pair = await pairOf(data.scores[0], a.id, b.id);
  said.textContent = `${data.scores[0].title}: A − B is ${shown(pair.difference, data.scores[0].share, true)}; ${verdict(data.scores[0], pair)}.`;
  const score = data.scores[document.getElementById("score").selectedIndex];
  document.querySelector("#scenes caption span").textContent = `${score.title} in ${score.unit}, and the difference A − B`;
  document.querySelector("#scenes tbody").replaceChildren(...byScene(score, a, b));
}

function start() {
  const asked = new URLSearchParams(location.hash.slice(1));
  for (const [select, key, place] of [[first, "a", 0], [second, "b", 1]]) {
    const found = data.methods.findIndex((method) => method.id === asked.get(key));
    select.selectedIndex = found < 0 ? place : found;
  }
  if (!asked.has("b") && first.selectedIndex === second.selectedIndex) second.selectedIndex = first.selectedIndex ? 0 : 1;
  draw();
}

for (const select of [first, second]) select.append(...data.methods.map((method) => el("option", {}, method.name)));
const scores = document.getElementById("score");
scores.append(...data.scores.map((score) => el("option", {}, score.title)));
scores.addEventListener("change", draw);
for (const select of [first, second]) {
  select.addEventListener("change", () => {
    const said = new URLSearchParams({ a: data.methods[first.selectedIndex].id, b: data.methods[second.selectedIndex].id });
    history.replaceState(null, "", `#${said}`);
    draw();
  });
}
document.getElementById("swap").addEventListener("click", () => {
  [first.selectedIndex, second.selectedIndex] = [second.selectedIndex, first.selectedIndex];
  first.dispatchEvent(new Event("change"));
});
window.addEventListener("hashchange", start);
start();
