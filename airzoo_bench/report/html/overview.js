// The parts of the page: what each is called, a table over all of them, and the line of links.
const TRACKS = { retrieval: "Aerial image retrieval", matching: "Cross-view matching", reconstruction: "Multi-view reconstruction" };

// The benchmark and the track, and where parts have both in common also what they differ in.
function partName(section) {
  const plain = (other) => `${other.truth.name}, ${other.track}`;
  const alike = page.sections.filter((other) => plain(other) === plain(section));
  return alike.length === 1 ? plain(section)
    : `${plain(section)} (${section.protocol.name} v${section.protocol.version}, ${section.protocol.fingerprint.slice(0, 6)}, truth ${section.truth.fingerprint.slice(0, 6)})`;
}

function queryCount(section) {
  return section.scenes.reduce((sum, scene) => sum + scene.queries, 0);
}

// The first of the paper's scores: the best value, its interval, who has it, and who ties with it.
function bestOverall(section) {
  const index = section.scores.findIndex((score) => score.headline);
  const score = section.scores[index];
  const { texts, marks } = section.standings.overall;
  const marked = (mark) => section.methods.map((_, place) => place).filter((place) => marks[place][index] === mark);
  const [first, ...more] = marked("best").length ? marked("best") : [0];
  const others = [more.length ? ` and ${more.length} more` : "", marked("tied").length ? `; ${marked("tied").length} ${marked("tied").length === 1 ? "other" : "others"} cannot be told from it` : ""];
  return { score, value: texts[first][index], name: `${section.methods[first].name}${others.join("")}`,
    limits: interval((section.intervals.overall[score.key] || [])[first]) };
}

function overviewTable() {
  const heads = [["Part", "text"], ["Methods", "roomy"], ["Queries", "roomy"], ["Score", "text"], ["Best", null], ["Method", "text"]];
  const rows = page.sections.map((section) => {
    const best = bestOverall(section);
    return el("tr", {},
      el("th", { scope: "row" }, el("a", { href: `#${section.id}`, onclick: follow }, partName(section))),
      el("td", { class: "roomy" }, String(section.methods.length)),
      el("td", { class: "roomy" }, section.byQuery ? queryCount(section).toLocaleString("en") : "–"),
      el("td", { class: "text", title: best.score.meaning || null }, best.score.heading),
      el("td", {}, best.value, best.limits),
      el("td", { class: "text" }, best.name));
  });
  return el("div", { class: "scroll", id: "overview" }, el("table", {},
    el("caption", {}, el("span", {}, "The parts of this page, and the best method of each by its first score, the average over scenes")),
    el("thead", {}, el("tr", {}, heads.map(([text, kind]) => el("th", { scope: "col", class: kind }, text)))), el("tbody", {}, rows)));
}

// Stays in sight: in which part one is, what it has, and the way to other parts.
function partLine(section, views) {
  const inside = el("ul", { class: "views" }, views.map(([name, text]) => el("li", {}, el("a", { href: `#${section.id}-${name}`, onclick: follow }, text))));
  return el("nav", { class: "line", "aria-label": partName(section) }, page.sections.length > 1 ? partMenu(section) : null, inside);
}

function partMenu(section) {
  const links = page.sections.map((other) => el("li", {}, el("a", { href: `#${other.id}`, "aria-current": other === section ? "true" : null, onclick: (event) => { menu.open = false; follow(event); } }, partName(other))));
  const top = el("li", {}, el("a", { href: "#overview", onclick: (event) => { menu.open = false; follow(event); } }, "Overview of all parts"));
  const menu = el("details", { class: "parts no-print", onkeydown: (event) => { if (event.key === "Escape" && menu.open) { menu.open = false; menu.firstChild.focus(); } } },
    el("summary", {}, partName(section)), el("ul", {}, top, links));
  document.addEventListener("pointerdown", (event) => { if (!menu.contains(event.target)) menu.open = false; });
  return menu;
}
