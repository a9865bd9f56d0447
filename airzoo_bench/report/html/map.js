// A scene's map: footprints with hits and misses of a method, and the tiles that it retrieved.
function mapView(section) {
  const state = { map: 0, method: 0, score: null, hits: true, misses: true, tiles: null, chosen: -1, x: 0, y: 0, scale: 1, scene: null, picture: null };
  const canvas = el("canvas", { tabindex: "0", role: "application", "aria-label": "Map. Arrows move it, plus and minus zoom, zero shows all of it, n and p go from query to query, Escape lets go of the query.",
    onkeydown: keys, onpointerdown: press, onwheel: wheel });
  const info = el("aside", { "aria-label": "The chosen query", onkeydown: (event) => { if (event.key === "Escape") { letGo(); canvas.focus(); } } });
  const counted = el("p", { class: "note", role: "status" });
  const status = el("p", { class: "sr", role: "status" });
  const context = canvas.getContext("2d");
  let ratio = 1;

  const hitScores = section.queryScores.filter((score) => section.queries.scores[score.key].values.every((value) => value === 0 || value === 1));
  const scores = hitScores.length ? hitScores : section.queryScores.slice(0, 1);
  state.score = scores[0];
  const sceneOf = (map) => section.scenes.findIndex((scene) => scene.id === map.scene);
  const scene = choice("Scene", section.maps.map((map, index) => [index, section.scenes[sceneOf(map)].title]), (value) => load(Number(value), null));
  const method = choice("Method", section.methods.map((found, index) => [index, found.name]), (value) => { state.method = Number(value); draw(); describe(); remember(true); });
  const score = choice("Hit by", scores.map((found, index) => [index, found.title]), async (value) => { state.score = scores[Number(value)]; await loadColumns(); draw(); describe(); });
  const ticks = [
    tick("Hits", true, (value) => { state.hits = value; draw(); }),
    tick("Misses", true, (value) => { state.misses = value; draw(); }),
    tick("All first tiles", false, draw),
  ];
  const buttons = [["Zoom in", () => zoom(1.5)], ["Zoom out", () => zoom(1 / 1.5)], ["Whole map", () => { fit(); draw(); }],
    ["Zoom to the query", () => { frame(); draw(); }], ["Previous query", () => step(-1)], ["Next query", () => step(1)]].map(([name, act]) => el("button", { type: "button", onclick: act }, name));
  section.showScene = async (place, row = null) => {
    const index = section.maps.findIndex((map) => map.scene === section.scenes[place].id);
    goTo(section, "map");
    scene.select.value = String(index);
    await load(index, row);
    if (row !== null) remember();
  };
  section.open.map = async (id, by) => {
    const loaded = await loadQueries(section);
    const row = loaded.ids.indexOf(id);
    const index = row < 0 ? -1 : section.maps.findIndex((map) => map.scene === section.scenes[loaded.scene[row]].id);
    goTo(section, "map");
    if (by !== undefined && !section.methods.some((found) => found.name === by)) { info.replaceChildren(el("p", { role: "alert" }, `This map has no method ${by}.`)); return; }
    if (index < 0) { info.replaceChildren(el("p", { role: "alert" }, `This map has no query ${id}.`)); return; }
    const named = section.methods.findIndex((found) => found.name === by);
    state.method = named < 0 ? 0 : named;
    method.select.value = String(state.method);
    scene.select.value = String(index);
    await load(index, row);
  };
  section.close.map = () => { if (state.chosen >= 0) { state.chosen = -1; draw(); describe(); } };

  // Writes the chosen query into the address.
  function remember(replaces = false) {
    if (state.chosen < 0) return;
    const name = section.methods[state.method].name;
    visit(addressOf(section, "map", state.loaded.ids[state.rows[state.chosen]], state.method ? name : undefined), replaces);
  }

  function letGo() {
    if (state.chosen < 0) return;
    section.close.map();
    visit(addressOf(section, "map"));
  }

  async function loadColumns() {
    state.column = await loadScore(section, state.score);
  }

  async function load(index, row) {
    const map = section.maps[index];
    const [loaded, rows, outlines, centres] = await Promise.all([loadQueries(section), unpack(map.rows), unpack(map.outlines), unpack(map.centres)]);
    const tiles = await loadTiles(map);
    await loadColumns();
    const picture = new Image();
    picture.src = map.picture;
    await picture.decode();
    Object.assign(state, { map: index, loaded, rows, outlines, centres, tiles, picture, chosen: row === null ? -1 : rows.indexOf(row) });
    fit();
    if (state.chosen >= 0) frame();
    draw();
    describe();
  }

  function resize() {
    ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * ratio);
    canvas.height = Math.round(canvas.clientHeight * ratio);
  }

  function fit() {
    resize();
    state.moved = false;
    const map = section.maps[state.map];
    state.scale = Math.min(canvas.clientWidth / map.width, canvas.clientHeight / map.height) || 1;
    state.x = (canvas.clientWidth - map.width * state.scale) / 2;
    state.y = (canvas.clientHeight - map.height * state.scale) / 2;
  }

  function zoom(factor, x = canvas.clientWidth / 2, y = canvas.clientHeight / 2) {
    const next = Math.min(40, Math.max(0.05, state.scale * factor));
    state.x = x - ((x - state.x) * next) / state.scale;
    state.y = y - ((y - state.y) * next) / state.scale;
    state.scale = next;
    state.moved = true;
    draw();
  }

  function centreAt(x, y) {
    if (Number.isNaN(x)) return;
    state.moved = true;
    state.x = canvas.clientWidth / 2 - x * state.scale;
    state.y = canvas.clientHeight / 2 - y * state.scale;
  }

  // Shows the chosen query with its tiles, as large as it can.
  function frame() {
    if (state.chosen < 0) return;
    const corners = (array, place) => [0, 1, 2, 3].map((corner) => point(array, 4 * place + corner));
    const points = [centreOf(state.chosen), ...corners(state.outlines, state.chosen),
      ...tilesAt(state.chosen).flatMap((one) => corners(state.tiles.outlines, one.tile))].filter(([x]) => !Number.isNaN(x));
    if (!points.length) return;
    const [[left, right], [above, below]] = [0, 1].map((axis) => {
      const values = points.map((one) => one[axis]);
      return [Math.min(...values), Math.max(...values)];
    });
    const fits = Math.min(canvas.clientWidth / (right - left), canvas.clientHeight / (below - above)) * 0.85;
    state.scale = Math.min(6, Math.max(0.05, fits));
    centreAt((left + right) / 2, (above + below) / 2);
  }

  function point(array, place) {
    const map = section.maps[state.map];
    const [x, y] = [array[2 * place], array[2 * place + 1]];
    return x === map.nowhere || y === map.nowhere ? [NaN, NaN] : [x / map.stepsPerPixel, y / map.stepsPerPixel];
  }

  function centreOf(place) {
    return point(state.centres, place);
  }

  function isShown(place) {
    return hits(place) ? state.hits : state.misses;
  }

  function hits(place) {
    return valueOf(section, state.column, state.method, state.rows[place]) >= 1;
  }

  function path(array, place) {
    context.beginPath();
    for (let corner = 0; corner < 4; corner += 1) {
      const [x, y] = point(array, 4 * place + corner);
      if (Number.isNaN(x)) return false;
      context.lineTo(x, y);
    }
    context.closePath();
    return true;
  }

  function draw() {
    if (!state.picture) return;
    if (canvas.width !== Math.round(canvas.clientWidth * ratio)) resize();
    const map = section.maps[state.map];
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
    context.translate(state.x, state.y);
    context.scale(state.scale, state.scale);
    context.drawImage(state.picture, 0, 0, map.width, map.height);
    // One finger scrolls the page over a whole map, and moves one that was zoomed.
    canvas.style.touchAction = state.moved ? "none" : "pan-y";
    const pixel = 1 / state.scale;
    const count = { hits: 0, misses: 0 };
    if (state.tiles && ticks[2].box.checked) drawTiles(pixel);
    for (let place = 0; place < state.rows.length; place += 1) {
      const hit = hits(place);
      count[hit ? "hits" : "misses"] += 1;
      // Around a chosen query the others step back.
      context.globalAlpha = state.chosen < 0 ? 1 : 0.35;
      if (isShown(place)) drawQuery(place, hit, pixel);
    }
    context.globalAlpha = 1;
    if (state.chosen >= 0) drawChosen(pixel);
    drawScale();
    counted.textContent = `${section.methods[state.method].name}: ${count.hits} hits and ${count.misses} misses by ${state.score.title}`;
  }

  function drawQuery(place, hit, pixel) {
    context.setLineDash(hit ? [] : [5 * pixel, 4 * pixel]);
    context.lineWidth = 2 * pixel;
    context.strokeStyle = hit ? "#56b4e9" : "#ff7f2a";
    if (path(state.outlines, place)) context.stroke();
    context.setLineDash([]);
    const [x, y] = centreOf(place);
    const r = 4.5 * pixel;
    context.beginPath();
    if (hit) context.arc(x, y, r, 0, 7);
    else { context.moveTo(x - r, y - r); context.lineTo(x + r, y + r); context.moveTo(x + r, y - r); context.lineTo(x - r, y + r); }
    context.lineWidth = 4 * pixel; context.strokeStyle = "#000"; context.stroke();
    context.lineWidth = 2 * pixel; context.strokeStyle = hit ? "#56b4e9" : "#ff7f2a"; context.stroke();
  }

  function tilesAt(place) {
    return tilesOf(state.tiles, section.methods.length, state.rows.length, state.method, place);
  }

  function drawTiles(pixel) {
    context.lineWidth = 1.5 * pixel;
    context.strokeStyle = TILE_HIT;
    const done = new Set();
    for (let place = 0; place < state.rows.length; place += 1) {
      const [first] = tilesAt(place);
      if (!first || first.rank > 1 || done.has(first.tile) || !isShown(place)) continue;
      done.add(first.tile);
      if (path(state.tiles.outlines, first.tile)) context.stroke();
    }
  }

  function drawChosen(pixel) {
    const outline = () => { context.lineWidth = 6 * pixel; context.strokeStyle = "#000"; context.stroke(); context.lineWidth = 3 * pixel; };
    if (path(state.outlines, state.chosen)) { outline(); context.strokeStyle = "#fff"; context.stroke(); }
    const [x, y] = centreOf(state.chosen);
    context.beginPath(); context.arc(x, y, 8 * pixel, 0, 7); outline(); context.strokeStyle = "#fff"; context.stroke();
    const found = tilesAt(state.chosen);
    for (const one of [...found].reverse()) {
      if (!path(state.tiles.outlines, one.tile)) continue;
      outline();
      context.setLineDash(one.hit ? [] : [7 * pixel, 5 * pixel]);
      context.strokeStyle = one.hit ? TILE_HIT : TILE_MISS;
      context.stroke();
      context.setLineDash([]);
    }
    tileBadges(context, found.map((one) => point(state.tiles.outlines, 4 * one.tile + 3)), found, pixel);
  }

  function drawScale() {
    const metres = section.maps[state.map].metresPerPixel / state.scale;
    const round = 10 ** Math.floor(Math.log10(metres * 150));
    const length = [5, 2, 1].map((factor) => factor * round).find((value) => value <= metres * 150);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const [x, y] = [12, canvas.clientHeight - 14];
    context.fillStyle = "rgba(255, 255, 255, 0.85)";
    context.fillRect(x - 6, y - 20, length / metres + 12, 28);
    context.fillStyle = "#000";
    context.fillRect(x, y, length / metres, 3);
    context.font = "12px sans-serif";
    context.fillText(`${length} m`, x, y - 5);
  }

  async function describe() {
    if (state.chosen < 0) {
      info.replaceChildren(el("p", { class: "soft" }, `Choose a footprint, or use “Next query”, to see its scores${state.tiles ? " and the tiles that were retrieved" : ""}.`));
      return;
    }
    const row = state.rows[state.chosen];
    const chosen = section.methods[state.method];
    const said = `${hits(state.chosen) ? "✓ Hit" : "✗ Miss"} by ${state.score.title}, ${chosen.name}.`;
    const found = tilesAt(state.chosen);
    const detail = await queryDetail(section, row);
    if (state.rows[state.chosen] !== row) return;
    status.textContent = `${state.loaded.ids[row]}: ${said}${found.map((one) => ` Tile ${one.rank} ${one.hit ? "hits" : "misses"}.`).join("")}`;
    info.replaceChildren(el("h4", {}, linkTo(section, "query", state.loaded.ids[row], state.loaded.ids[row])), el("p", {}, said),
      state.tiles ? tilesList(section, chosen, found, showTile, !Number.isNaN(point(state.outlines, 4 * state.chosen)[0])) : "", ...detail);
  }

  function showTile(tile) {
    const [a, c] = [point(state.tiles.outlines, 4 * tile), point(state.tiles.outlines, 4 * tile + 2)];
    centreAt((a[0] + c[0]) / 2, (a[1] + c[1]) / 2);
    draw();
    canvas.scrollIntoView({ block: "nearest" });
  }

  function step(by) {
    const order = [...state.rows.keys()].filter(isShown);
    if (!order.length) return;
    const now = order.indexOf(state.chosen);
    state.chosen = order[(now + by + order.length) % order.length];
    if (now < 0) state.chosen = by > 0 ? order[0] : order[order.length - 1];
    if (!inSight(state.chosen)) centreAt(...centreOf(state.chosen));
    draw();
    describe();
    remember(true);
  }

  function inSight(place) {
    const [x, y] = centreOf(place);
    const [left, top] = [x * state.scale + state.x, y * state.scale + state.y];
    return left > 0 && top > 0 && left < canvas.clientWidth && top < canvas.clientHeight;
  }

  function keys(event) {
    const moves = { ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] };
    const acts = { "+": () => zoom(1.5), "=": () => zoom(1.5), "-": () => zoom(1 / 1.5), n: () => step(1), p: () => step(-1), Escape: letGo, 0: () => { fit(); draw(); } };
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key in moves) { state.moved = true; state.x += moves[event.key][0]; state.y += moves[event.key][1]; draw(); }
    else if (event.key in acts) acts[event.key]();
    else return;
    event.preventDefault();
  }

  // The wheel zooms only where the map was chosen, so that it never holds up the page.
  function wheel(event) {
    if (document.activeElement !== canvas && !event.ctrlKey) return;
    event.preventDefault();
    zoom(event.deltaY < 0 ? 1.2 : 1 / 1.2, event.offsetX, event.offsetY);
  }

  function press(event) {
    const start = [event.clientX, event.clientY, state.x, state.y];
    const mouse = event.pointerType === "mouse";
    const move = (moved) => {
      if (!mouse && !state.moved) return;
      state.moved = true;
      state.x = start[2] + moved.clientX - start[0];
      state.y = start[3] + moved.clientY - start[1];
      draw();
    };
    const release = (end) => {
      window.removeEventListener("pointermove", move);
      window.removeEventListener("pointerup", release);
      window.removeEventListener("pointercancel", release);
      if (end.type === "pointerup" && Math.hypot(end.clientX - start[0], end.clientY - start[1]) < 4) pick(event.offsetX, event.offsetY);
    };
    window.addEventListener("pointermove", move);
    window.addEventListener("pointerup", release);
    window.addEventListener("pointercancel", release);
  }

  function pick(x, y) {
    const at = [(x - state.x) / state.scale, (y - state.y) / state.scale];
    let nearest = Infinity;
    for (let place = 0; place < state.rows.length; place += 1) {
      const [px, py] = centreOf(place);
      const away = isShown(place) ? Math.hypot(px - at[0], py - at[1]) : NaN;
      if (away < nearest) { nearest = away; state.chosen = place; }
    }
    draw();
    describe();
    remember();
  }

  const legend = el("ul", { class: "legend" },
    [["hit", "○ hit: footprint"], ["miss", "× miss: footprint"], ["chosen", "chosen query"], ...(section.maps.some((map) => map.tiles) ? [["tile-hit", "✓ retrieved tile that answers, with its rank"], ["tile-miss", "✗ one that does not"]] : [])]
      .map(([name, text]) => el("li", {}, el("span", { class: `swatch ${name}` }), text)));
  new ResizeObserver(() => { if (!state.picture || !canvas.clientWidth) return;
    if (state.moved) resize();
    else fit();
    draw(); }).observe(canvas);
  drawn.push(load(0, null));
  const shownTicks = section.maps.some((map) => map.tiles) ? ticks : ticks.slice(0, 2);
  return panel(section, "map", "Map", el("div", { class: "controls" }, scene.node, method.node, score.node, shownTicks.map((made) => made.node)),
    el("div", { class: "controls" }, buttons), el("div", { class: "map" }, el("div", {}, canvas, legend, counted, section.tilesLeftOut ? el("p", { class: "note" }, section.tilesLeftOut) : null, status), info));
}
