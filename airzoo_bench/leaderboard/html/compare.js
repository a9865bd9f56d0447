// Compares two methods by what was computed when the page was made; the address names them.
const board = JSON.parse(document.getElementById("data").textContent);
const scores = board.scores.filter((score) => score.key in board.pairs);
const { ids } = board.pairs[scores[0].key];
const units = { share: "%", m: "m", deg: "°" };
// The rows that were ranked, the best first; a name that is there twice is told apart by its team.
const methods = board.rows.filter((row) => ids.includes(row.id)).map((row) => ({ ...row, at: ids.indexOf(row.id) }));
const nameOf = (row) => (methods.filter((other) => other.method === row.method).length > 1 ? `${row.method} (${row.team})` : row.method);
const [first, second, byScore] = ["a", "b", "score"].map((id) => document.getElementById(id));

// Fills an element. Texts become text nodes: nothing in the data is ever read as HTML.
function filled(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}
const el = (tag, attributes, ...children) => filled(document.createElement(tag), attributes, children);
const drawn = (tag, attributes, ...children) => filled(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);

async function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Float32Array(await new Response(stream).arrayBuffer());
}

// JSON has no infinite numbers: they are texts, and a missing one is null.
const number = (value) => (value === null || value === undefined ? NaN : Number(value));

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
  const pairs = board.pairs[score.key];
  pairs.unpacked ??= Promise.all(["low", "high", "p", "p_holm"].map((key) => unpacked(pairs[key])));
  const [less, more] = [Math.min(a.at, b.at), Math.max(a.at, b.at)];
  const place = less * (2 * ids.length - less - 1) / 2 + more - less - 1;
  let [low, high, p, holm] = (await pairs.unpacked).map((values) => values[place]);
  if (a.at > b.at) [low, high] = [-high, -low];
  const [one, other] = [a, b].map((row) => number(row.scores[score.key].value));
  return { low, high, p, holm, one, other, difference: one - other };
}

function verdict(score, pair) {
  if (Number.isNaN(pair.holm)) return "no test";
  if (pair.holm > 0.05 || pair.difference === 0) return "cannot be told apart";
  return (pair.difference > 0) === score.higher_is_better ? "A is better" : "B is better";
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

async function overall(a, b) {
  return Promise.all(scores.map(async (score) => {
    const pair = await pairOf(score, a, b);
    const share = score.unit === "share";
    const limits = Number.isNaN(pair.low) ? "–" : `${shown(pair.low, share, true)} to ${shown(pair.high, share, true)}`;
    return el("tr", {}, head(`${score.title} [${units[score.unit]}]`), cell(shown(pair.one, share)), cell(shown(pair.other, share)),
      cell(shown(pair.difference, share, true)), cell(limits), cell(picture(pair), "text"),
      cell(shownP(pair.p)), cell(shownP(pair.holm)), cell(verdict(score, pair), "text"));
  }));
}

function byScene(score, a, b) {
  const share = score.unit === "share";
  return board.scenes.map((scene) => {
    const [one, other] = [a, b].map((row) => number(row.scenes[scene.id]?.[score.key]?.[0]));
    return el("tr", {}, head(scene.title), cell(shown(one, share)), cell(shown(other, share)), cell(shown(one - other, share, true)));
  });
}

async function draw() {
  const [a, b] = [methods[first.value], methods[second.value]];
  document.getElementById("found").hidden = a === b;
  const said = document.getElementById("said");
  if (a === b) {
    said.textContent = "Choose two different methods.";
    return;
  }
  for (const [id, row] of [["name-a", a], ["name-b", b]]) document.getElementById(id).setAttribute("href", `${row.id}.html`);
  const command = document.getElementById("command");
  command.hidden = false;
  command.lastElementChild.textContent = `airzoo-bench compare ${a.history[0].files} ${b.history[0].files} --scene ${board.scenes[0].id}`;
  document.querySelector("#overall tbody").replaceChildren(...await overall(a, b));
  const pair = await pairOf(scores[0], a, b);
  said.textContent = `${scores[0].title}: ${nameOf(a)} − ${nameOf(b)} is ${shown(pair.difference, scores[0].unit === "share", true)} ${units[scores[0].unit]}; ${verdict(scores[0], pair)}.`;
  const score = scores[byScore.selectedIndex];
  document.querySelector("#scenes caption span").textContent = `${score.title} in ${units[score.unit]}, and the difference A − B`;
  document.querySelector("#scenes tbody").replaceChildren(...byScene(score, a, b));
}

function start() {
  const asked = new URLSearchParams(location.hash.slice(1));
  for (const [select, key, place] of [[first, "a", 0], [second, "b", 1]]) {
    const found = methods.findIndex((row) => row.id === asked.get(key));
    select.selectedIndex = found < 0 ? place : found;
  }
  if (!asked.has("b") && first.selectedIndex === second.selectedIndex) second.selectedIndex = first.selectedIndex ? 0 : 1;
  draw();
}

for (const select of [first, second]) {
  select.append(...methods.map((row, at) => el("option", { value: at }, nameOf(row))));
  select.addEventListener("change", () => {
    const asked = new URLSearchParams({ a: methods[first.value].id, b: methods[second.value].id });
    history.replaceState(null, "", `#${asked}`);
    draw();
  });
}
byScore.append(...scores.map((score) => el("option", {}, score.title)));
byScore.addEventListener("change", draw);
document.getElementById("swap").addEventListener("click", () => {
  [first.selectedIndex, second.selectedIndex] = [second.selectedIndex, first.selectedIndex];
  first.dispatchEvent(new Event("change"));
});
window.addEventListener("hashchange", start);
start();
