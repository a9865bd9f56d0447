// What is told of one query: its conditions and scores.
async function queryDetail(section, row) {
  const loaded = await loadQueries(section);
  const columns = await Promise.all(section.queryScores.map((score) => loadScore(section, score)));
  const facts = Object.fromEntries([["Scene", section.scenes[loaded.scene[row]].title],
    ...loaded.conditions.map((column) => [column.title, column.texts[column.codes[row]]])]);
  const scores = section.queryScores.map((score, place) => {
    const value = (found) => valueOf(section, columns[place], found.index, row);
    return { title: score.headingOfOne, value, show: (found) => textOf(section, columns[place], found.index, row), bestFirst: score.higher ? "descending" : "ascending", hint: score.meaning };
  });
  const table = sortableTable("Scores of this query", [methodColumn(), ...scores], methodRows(section));
  return [keyList(facts), table.node];
}

function mapButton(section, row) {
  const place = section.queries.loaded.scene[row];
  const onMap = section.maps.some((map) => map.scene === section.scenes[place].id);
  return onMap ? el("button", { type: "button", class: "no-print", onclick: () => section.showScene(place, row) }, "Show it on the map") : null;
}

function pictureRow(section, row) {
  const found = section.hardest.find((one) => one.row === row);
  if (!found || !found.pictures.length) return null;
  const large = found.pictures.map((picture) =>
    el("figure", {}, el("img", { src: picture.src, alt: picture.title }), el("figcaption", {}, picture.title)));
  const tiles = found.tiles.map((tile) => el("li", { class: tile.hit ? "frame-hit" : "frame-miss" },
    el("img", { src: tile.src, alt: `Tile ${tile.title}, rank ${tile.rank}`, title: tile.title }), el("span", {}, `${tile.rank} ${saidHit(tile.hit)}`)));
  return el("div", {}, el("div", { class: "pictures" }, large),
    tiles.length ? el("p", { class: "note" }, `First tiles of ${section.methods[0].name}:`) : null, tiles.length ? el("ul", { class: "frames" }, tiles) : null);
}

function hardestView(section) {
  const list = el("ol", { class: "cards" });
  const first = section.queryScores[0];

  function values(column, row) {
    const { methods } = section;
    const said = methods.map((method, number) => el("li", {}, el("span", {}, method.name), el("b", {}, textOf(section, column, number, row))));
    const hits = methods.filter((_, number) => valueOf(section, column, number, row) === 1).length;
    const head = first.isHit ? `${first.title}: hit by ${hits} of ${methods.length} methods` : first.headingOfOne;
    return [el("p", {}, head), folded(methods.length, 6, `Each of ${methods.length} methods`, el("ul", { class: "values" }, said))];
  }

  drawn.push((async () => {
    const loaded = await loadQueries(section);
    const column = await loadScore(section, first);
    list.replaceChildren(...section.hardest.map(({ row }) => {
      const more = el("details", { class: "no-print" }, el("summary", {}, "Conditions and all scores"));
      more.addEventListener("toggle", async () => {
        if (more.children.length === 1) more.append(...(await queryDetail(section, row)));
      });
      return el("li", { class: "card" }, el("h4", {}, linkTo(section, "query", loaded.ids[row], loaded.ids[row])),
        pictureRow(section, row), ...values(column, row), mapButton(section, row), more);
    }));
  })());
  return panel(section, "hardest", "Hardest queries", el("p", { class: "note" }, section.hardestOrder), list);
}
