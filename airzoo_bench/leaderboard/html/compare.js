// Compares two methods by what was computed when the page was made; the address names them.
const data = JSON.parse(document.getElementById("data").textContent);
const [first, second, byScore] = ["a", "b", "score"].map((id) => document.getElementById(id));

// Makes an element. Texts become text nodes: nothing in the data is ever read as HTML.
function el(tag, attributes, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

function drawn(tag, attributes, ...children) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

async function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Float32Array(await new Response(stream).arrayBuffer());
}

// JSON has no infinite numbers: they are texts, and what is missing is null.
const number = (value) => (value === null || value === undefined ? NaN : value === "inf" ? Infinity : value);

function shown(value, share, signed = false) {
  if (Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "inf" : "−inf";
  const text = Math.abs(share ? 100 * value : value).toFixed(2);
  if (Number(text) === 0) return text;
  return (value < 0 ? "−" : signed ? "+" : "") + text;
}

const shownP = (p) => (Number.isNaN(p) ? "–" : p < 0.00005 ? "< 0.0001" : p.toFixed(4));

// What is known of two methods by one score, as the difference of the first to the second.
async function pairOf(score, i, j) {
  score.unpacked ??= Promise.all(["low", "high", "p", "p_holm"].map((key) => unpacked(score[key])));
  const [less, more] = [Math.min(i, j), Math.max(i, j)];
  const place = less * (2 * data.methods.length - less - 1) / 2 + more - less - 1;
  let [low, high, p, holm] = (await score.unpacked).map((values) => values[place]);
  if (i > j) [low, high] = [-high, -low];
  const [one, other] = [number(score.values[i]), number(score.values[j])];
  return { low, high, p, holm, one, other, difference: one - other };
}

function verdict(score, pair) {
  if (Number.isNaN(pair.holm)) return "no test";
  if (pair.holm > 0.05 || pair.difference === 0) return "cannot be told apart";
  return (pair.difference > 0) === score.higher ? "A is better" : "B is better";
}

// The interval of a difference on a line with zero in its middle.
function picture(pair) {
  const most = Math.max(...[pair.low, pair.high, pair.difference].map(Math.abs).filter(Number.isFinite), 1e-9);
  const at = (value) => Math.round((56 + 50 * value / most) * 10) / 10;
  const parts = [drawn("line", { class: "rule", x1: 6, x2: 106, y1: 6, y2: 6 }), drawn("line", { class: "zero", x1: 56, x2: 56, y1: 1, y2: 11 })];
  if (Number.isFinite(pair.low + pair.high)) parts.push(drawn("line", { class: "whisker", x1: at(pair.low), x2: at(pair.high), y1: 6, y2: 6 }));
  if (Number.isFinite(pair.difference)) parts.push(drawn("circle", { class: "dot", cx: at(pair.difference), cy: 6, r: 3 }));
  return drawn("svg", { width: 112, height: 12, viewBox: "0 0 112 12", "aria-hidden": "true" }, ...parts);
}

const cell = (content, kind = "num") => el("td", { class: kind }, content);
const head = (text) => el("th", { scope: "row" }, text);

async function overall(i, j) {
  return Promise.all(data.scores.map(async (score) => {
    const pair = await pairOf(score, i, j);
    const limits = Number.isNaN(pair.low) ? "–" : `${shown(pair.low, score.share, true)} to ${shown(pair.high, score.share, true)}`;
    return el("tr", {}, head(`${score.title} [${score.unit}]`), cell(shown(pair.one, score.share)), cell(shown(pair.other, score.share)),
      cell(shown(pair.difference, score.share, true)), cell(limits), cell(picture(pair), "text"),
      cell(shownP(pair.p)), cell(shownP(pair.holm)), cell(verdict(score, pair), "text"));
  }));
}

function byScene(score, i, j) {
  return data.scenes.map((title, place) => {
    const [one, other] = [i, j].map((at) => number(score.scenes[place][at]));
    return el("tr", {}, head(title), cell(shown(one, score.share)), cell(shown(other, score.share)), cell(shown(one - other, score.share, true)));
  });
}

async function draw() {
  const [i, j] = [Number(first.value), Number(second.value)];
  const [a, b] = [data.methods[i], data.methods[j]];
  document.getElementById("found").hidden = i === j;
  const said = document.getElementById("said");
  if (i === j) {
    said.textContent = "Choose two different methods.";
    return;
  }
  for (const [id, method] of [["name-a", a], ["name-b", b]]) document.getElementById(id).setAttribute("href", `${method.id}.html`);
  const command = document.getElementById("command");
  command.hidden = !a.run || !b.run;
  command.lastElementChild.textContent = `airzoo-bench compare ${a.run} ${b.run} --scene ${data.scene}`;
  document.querySelector("#overall tbody").replaceChildren(...await overall(i, j));
  const pair = await pairOf(data.scores[0], i, j);
  said.textContent = `${data.scores[0].title}: ${a.name} − ${b.name} is ${shown(pair.difference, data.scores[0].share, true)} ${data.scores[0].unit}; ${verdict(data.scores[0], pair)}.`;
  const score = data.scores[byScore.selectedIndex];
  document.querySelector("#scenes caption span").textContent = `${score.title} in ${score.unit}, and the difference A − B`;
  document.querySelector("#scenes tbody").replaceChildren(...byScene(score, i, j));
}

function start() {
  const asked = new URLSearchParams(location.hash.slice(1));
  for (const [select, key, place] of [[first, "a", 0], [second, "b", 1]]) {
    const found = data.methods.findIndex((method) => method.id === asked.get(key));
    if (found < 0) select.selectedIndex = place;
    else select.value = found;
  }
  if (!asked.has("b") && first.selectedIndex === second.selectedIndex) second.selectedIndex = first.selectedIndex ? 0 : 1;
  draw();
}

for (const select of [first, second]) {
  select.append(...data.order.map((at) => el("option", { value: at }, data.methods[at].name)));
  select.addEventListener("change", () => {
    const asked = new URLSearchParams({ a: data.methods[first.value].id, b: data.methods[second.value].id });
    history.replaceState(null, "", `#${asked}`);
    draw();
  });
}
byScore.append(...data.scores.map((score) => el("option", {}, score.title)));
byScore.addEventListener("change", draw);
document.getElementById("swap").addEventListener("click", () => {
  [first.selectedIndex, second.selectedIndex] = [second.selectedIndex, first.selectedIndex];
  first.dispatchEvent(new Event("change"));
});
window.addEventListener("hashchange", start);
start();
