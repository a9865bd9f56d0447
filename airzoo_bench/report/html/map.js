// A scene's map: what is chosen on it, by whom and by address, and what is told of it.
function mapView(section) {
  const scores = section.queryScores.filter((score) => score.isHit);
  const state = { map: 0, method: 0, score: scores[0] || null, hits: true, misses: true, first: false, tiles: null, chosen: -1, x: 0, y: 0, scale: 1, ratio: 1, picture: null };
  const canvas = el("canvas", { tabindex: "0", role: "application", "aria-label": "Map. Arrows move it, plus and minus zoom, zero shows all of it, n and p go from query to query, Escape lets go of the query." });
  const info = el("aside", { "aria-label": "The chosen query", onkeydown: (event) => { if (event.key === "Escape") { letGo(); canvas.focus(); } } });
  const counted = el("p", { class: "note", role: "status" });
  const status = el("p", { class: "sr", role: "status" });
  const places = mapPlaces(section, state);
  const painter = mapPainter(section, canvas, state, places);
  const moves = mapMoves(section, canvas, state, places, painter, { step, letGo, choose });

  const indexOf = (place) => section.maps.findIndex((map) => map.scene === section.scenes[place].id);
  const titles = section.maps.map((map) => section.scenes.find((scene) => scene.id === map.scene).title);
  const scene = choice("Scene", titles.map((title, index) => [index, title]), (value) => load(Number(value), null));
  const method = choice("Method", section.methods.map((found, index) => [index, found.name]), (value) => { state.method = Number(value); refresh(); remember(true); });
  const score = choice("Hit by", scores.map((found, index) => [index, found.title]), async (value) => { state.score = scores[Number(value)]; await loadColumn(); refresh(); });
  const hasTiles = section.maps.some((map) => map.tiles);
  const ticks = [["Hits", "hits", state.score], ["Misses", "misses", state.score], ["First tiles of all queries", "first", hasTiles]].filter(([, , there]) => there)
    .map(([label, key]) => tick(label, state[key], (value) => { state[key] = value; painter.draw(); }));

  section.showScene = async (place, row = null) => {
    const loaded = await loadQueries(section);
    jump(row === null ? addressOf(section, "map") : addressFor(loaded, row));
    goTo(section, "map");
    scene.select.value = String(indexOf(place));
    await load(indexOf(place), row);
  };
  section.open.map = async (id, by) => {
    const loaded = await loadQueries(section);
    const row = loaded.ids.indexOf(id);
    const index = row < 0 ? -1 : indexOf(loaded.scene[row]);
    const named = section.methods.findIndex((found) => found.name === by);
    goTo(section, "map");
    if (by !== undefined && named < 0) { info.replaceChildren(el("p", { role: "alert" }, `This map has no method ${by}.`)); return; }
    if (index < 0) { info.replaceChildren(el("p", { role: "alert" }, `This map has no query ${id}.`)); return; }
    state.method = Math.max(named, 0);
    method.select.value = String(state.method);
    scene.select.value = String(index);
    await load(index, row);
  };
  section.close.map = () => { if (state.chosen >= 0) { state.chosen = -1; refresh(); } };

  function addressFor(loaded, row) {
    return addressOf(section, "map", loaded.ids[row], state.method ? section.methods[state.method].name : undefined);
  }

  // Writes the chosen query into the address.
  function remember(replaces = false) {
    if (state.chosen >= 0) visit(addressFor(state.loaded, state.rows[state.chosen]), replaces);
  }

  function letGo() {
    if (state.chosen < 0) return;
    section.close.map();
    visit(addressOf(section, "map"));
  }

  function choose(place) {
    if (place >= 0) state.chosen = place;
    refresh();
    remember();
  }

  async function loadColumn() {
    state.column = state.score && (await loadScore(section, state.score));
  }

  async function load(index, row) {
    const map = section.maps[index];
    const [loaded, rows, outlines, centres] = await Promise.all([loadQueries(section), unpack(map.rows), unpack(map.outlines), unpack(map.centres)]);
    const tiles = await loadTiles(map);
    await loadColumn();
    const picture = new Image();
    picture.src = map.picture;
    await picture.decode();
    Object.assign(state, { map: index, loaded, rows, outlines, centres, tiles, picture, chosen: row === null ? -1 : rows.indexOf(row) });
    moves.fit();
    if (state.chosen >= 0) moves.frame();
    refresh();
  }

  function refresh() {
    painter.draw();
    const total = state.rows.length;
    const hits = [...state.rows.keys()].filter(places.isHit).length;
    counted.textContent = state.score ? `${section.methods[state.method].name}: ${hits} hits and ${total - hits} misses by ${state.score.title}` : `${total} queries`;
    describe();
  }

  async function describe() {
    if (state.chosen < 0) {
      info.replaceChildren(el("p", { class: "soft" }, `Choose a footprint, or step from query to query, to see its scores${state.tiles ? " and the tiles that were retrieved" : ""}.`));
      return;
    }
    const row = state.rows[state.chosen];
    const id = state.loaded.ids[row];
    const chosen = section.methods[state.method];
    const said = state.score ? `${places.isHit(state.chosen) ? "✓ Hit" : "✗ Miss"} by ${state.score.title}, ${chosen.name}.` : "";
    const found = places.tilesAt(state.chosen);
    const detail = await queryDetail(section, row);
    if (state.rows[state.chosen] !== row) return;
    status.textContent = `${id}: ${said}${found.map((one) => ` Tile ${one.rank} ${one.hit ? "hits" : "misses"}.`).join("")}`;
    info.replaceChildren(el("h4", {}, linkTo(section, "query", id, id)), el("p", {}, said),
      state.tiles ? tilesList(section, chosen, found, showTile, !Number.isNaN(places.outlineOf(state.chosen)[0][0])) : "", ...detail);
  }

  function showTile(tile) {
    const [a, , c] = places.outlineOfTile(tile);
    moves.centreAt((a[0] + c[0]) / 2, (a[1] + c[1]) / 2);
    painter.draw();
    canvas.scrollIntoView({ block: "nearest" });
  }

  function step(by) {
    const order = [...state.rows.keys()].filter(places.isShown);
    if (!order.length) return;
    const now = order.indexOf(state.chosen);
    state.chosen = now < 0 ? order.at(by > 0 ? 0 : -1) : order[(now + by + order.length) % order.length];
    if (!moves.inSight(state.chosen)) moves.centreAt(...places.centreOf(state.chosen));
    refresh();
    remember(true);
  }

  drawn.push(load(0, null));
  const buttons = [["Zoom in", "+", () => moves.zoom(1.5)], ["Zoom out", "−", () => moves.zoom(1 / 1.5)], ["Whole map", "Whole", () => { moves.fit(); painter.draw(); }],
    ["Zoom to the query", "Query", () => { moves.frame(); painter.draw(); }], ["Previous query", "‹", () => step(-1)], ["Next query", "›", () => step(1)]]
    .map(([name, short, act]) => el("button", { type: "button", "aria-label": name, onclick: act }, el("span", { class: "long" }, name), el("span", { class: "short" }, short)));
  return panel(section, "map", "Map",
    el("div", { class: "map-controls" }, el("div", { class: "controls" }, scene.node, method.node),
      narrowFolded("What is drawn", el("div", { class: "controls" }, scores.length ? score.node : null, ticks.map((made) => made.node)))),
    el("div", { class: "map" },
      el("div", { class: "map-view" }, canvas, el("div", { class: "controls map-buttons" }, buttons), counted, status),
      info,
      el("div", { class: "map-key" }, mapLegend(section, scores.length > 0), section.tilesLeftOut ? el("p", { class: "note" }, section.tilesLeftOut) : null)));
}
