// Two methods that a reader picks, with the paired tests between them, which were made with the page.
function pairsView(section) {
  const holder = el("div", {});
  const state = { one: 0, other: 1 };
  const { count } = section.pairs;
  const names = section.methods.slice(0, count).map((method, index) => [index, method.name]);

  async function draw() {
    const [first, second] = [Math.min(state.one, state.other), Math.max(state.one, state.other)];
    if (first === second) { holder.replaceChildren(el("p", { class: "note" }, "Pick two different methods.")); return; }
    const found = (await unpack(section.pairs.pairs))[first][second - first - 1];
    holder.replaceChildren(pairTable(section, found, first, second), el("ul", { class: "notes" }, found.map((pair) => el("li", {}, pair.sentence))));
  }

  const picks = [["one", "Compare"], ["other", "with"]].map(([key, label]) => choice(label, names, (value) => { state[key] = Number(value); draw(); }));
  picks[1].select.value = "1";
  drawn.push(draw());
  const most = count < section.methods.length ? ` Of the best ${count} methods: there are too many for all pairs.` : "";
  return panel(section, "pairs", "Two methods",
    el("div", { class: "controls" }, picks.map((pick) => pick.node)), holder,
    el("p", { class: "note" }, `Paired by ${section.byQuery ? "query" : "scene"}, of the average over scenes; p corrected: after Holm for all pairs of methods; ${section.pairs.resamples} resamples.${most}`));
}

function pairTable(section, found, first, second) {
  const [one, other] = [section.methods[first].name, section.methods[second].name];
  const heads = [["Score", "text"], [one, null], [other, null], ["Difference", null], ["95 % interval", null], ["p", null], ["p corrected", null], ["Verdict", "text"]];
  const rows = found.map((pair) => el("tr", {}, el("th", { scope: "row", class: "text" }, pair.score),
    [...pair.values, pair.difference, pair.interval, pair.p, pair.pHolm].map((text) => el("td", text.startsWith("none") ? { class: "why" } : {}, text)), el("td", { class: "text" }, pair.verdict)));
  return el("div", { class: "scroll" }, el("table", { class: "pairs" },
    el("caption", {}, el("span", {}, `${other} minus ${one}; the verdict is that on ${other}`)),
    el("thead", {}, el("tr", {}, heads.map(([text, kind]) => el("th", { scope: "col", class: kind }, text)))), el("tbody", {}, rows)));
}
