// A scene's map: footprints with hits and misses of a method, and the tiles that it ranked first.
function mapView(section, open) {
  const state = { map: 0, method: 0, score: null, hits: true, misses: true, tiles: null, chosen: -1, x: 0, y: 0, scale: 1, scene: null, picture: null };
  const canvas = el("canvas", { tabindex: "0", role: "img", "aria-label": "Map. Arrows move it, plus and minus zoom, n and p go from query to query.",
    onkeydown: keys, onpointerdown: press, onwheel: wheel });
  const info = el("aside", { "aria-live": "polite" });
  const status = el("p", { class: "note", role: "status" });
  const context = canvas.getContext("2d");
  let ratio = 1;

  const hitScores = section.queryScores.filter((score) => section.queries.scores[score.key].values.every((value) => value === 0 || value === 1));
  const scores = hitScores.length ? hitScores : section.queryScores.slice(0, 1);
  state.score = scores[0];
  const sceneOf = (map) => section.scenes.findIndex((scene) => scene.id === map.scene);
  const scene = choice("Scene", section.maps.map((map, index) => [index, section.scenes[sceneOf(map)].title]), (value) => load(Number(value), -1));
  const method = choice("Method", section.methods.map((found, index) => [index, found.name]), (value) => { state.method = Number(value); draw(); describe(); });
  const score = choice("Hit by", scores.map((found, index) => [index, found.title]), async (value) => { state.score = scores[Number(value)]; await loadColumns(); draw(); describe(); });
  const ticks = [
    tick("Hits", true, (value) => { state.hits = value; draw(); }),
    tick("Misses", true, (value) => { state.misses = value; draw(); }),
    tick("All first tiles", false, draw),
  ];
  const buttons = [["Zoom in", () => zoom(1.5)], ["Zoom out", () => zoom(1 / 1.5)], ["Whole map", () => { fit(); draw(); }],
    ["Previous query", () => step(-1)], ["Next query", () => step(1)]].map(([name, act]) => el("button", { type: "button", onclick: act }, name));
  open.map = async (place, row) => {
    const index = section.maps.findIndex((map) => map.scene === section.scenes[place].id);
    goTo(section, "map");
    scene.select.value = String(index);
    await load(index, row);
  };

  async function loadColumns() {
    state.column = await loadScore(section, state.score);
  }

  async function load(index, row) {
    const map = section.maps[index];
    const [loaded, rows, outlines, centres] = await Promise.all([loadQueries(section), unpack(map.rows), unpack(map.outlines), unpack(map.centres)]);
    const tiles = map.tiles ? await Promise.all([unpack(map.tiles), unpack(map.tileOutlines), unpack(map.first)]) : null;
    await loadColumns();
    const picture = new Image();
    picture.src = map.picture;
    await picture.decode();
    Object.assign(state, { map: index, loaded, rows, outlines, centres, tiles, picture, chosen: row === null ? -1 : rows.indexOf(row) });
    fit();
    if (state.chosen >= 0) centreOn(state.chosen);
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

  function centreOn(place) {
    const [x, y] = centreOf(place);
    if (Number.isNaN(x)) return;
    state.moved = true;
    state.x = canvas.clientWidth / 2 - x * state.scale;
    state.y = canvas.clientHeight / 2 - y * state.scale;
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
    const pixel = 1 / state.scale;
    const count = { hits: 0, misses: 0 };
    if (state.tiles && state.tiles[0] && ticks[2].box.checked) drawTiles(pixel);
    for (let place = 0; place < state.rows.length; place += 1) {
      const hit = hits(place);
      count[hit ? "hits" : "misses"] += 1;
      if (isShown(place)) drawQuery(place, hit, pixel);
    }
    if (state.chosen >= 0) drawChosen(pixel);
    drawScale();
    status.textContent = `${section.methods[state.method].name}: ${count.hits} hits and ${count.misses} misses by ${state.score.title}`;
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

  function tileOf(place, method) {
    const code = state.tiles[2][method * state.rows.length + place];
    return code < state.tiles[0].length ? code : -1;
  }

  function drawTiles(pixel) {
    context.lineWidth = 1.5 * pixel;
    context.strokeStyle = "#f0e442";
    const drawn = new Set();
    for (let place = 0; place < state.rows.length; place += 1) {
      const tile = tileOf(place, state.method);
      if (tile < 0 || drawn.has(tile) || !isShown(place)) continue;
      drawn.add(tile);
      if (path(state.tiles[1], tile)) context.stroke();
    }
  }

  function drawChosen(pixel) {
    const outline = () => { context.lineWidth = 6 * pixel; context.strokeStyle = "#000"; context.stroke(); context.lineWidth = 3 * pixel; };
    if (path(state.outlines, state.chosen)) { outline(); context.strokeStyle = "#fff"; context.stroke(); }
    const [x, y] = centreOf(state.chosen);
    context.beginPath(); context.arc(x, y, 8 * pixel, 0, 7); outline(); context.strokeStyle = "#fff"; context.stroke();
    const tile = state.tiles ? tileOf(state.chosen, state.method) : -1;
    if (tile < 0 || !path(state.tiles[1], tile)) return;
    outline(); context.strokeStyle = "#f0e442"; context.stroke();
    const [a, c] = [point(state.tiles[1], 4 * tile), point(state.tiles[1], 4 * tile + 2)];
    context.setLineDash([3 * pixel, 3 * pixel]);
    context.beginPath(); context.moveTo(x, y); context.lineTo((a[0] + c[0]) / 2, (a[1] + c[1]) / 2); context.stroke();
    context.setLineDash([]);
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
      info.replaceChildren(el("p", { class: "soft" }, "Click a footprint, or use “Next query”, to see its scores and the tile that was ranked first."));
      return;
    }
    const row = state.rows[state.chosen];
    const tile = state.tiles ? tileOf(state.chosen, state.method) : -1;
    const facts = el("p", {}, `${hits(state.chosen) ? "Hit" : "Miss"} by ${state.score.title}. `, tile >= 0 ? `First tile: ${state.tiles[0][tile]}` : "");
    const detail = await queryDetail(section, row, {});
    info.replaceChildren(facts, detail);
  }

  function step(by) {
    const order = [...state.rows.keys()].filter(isShown);
    if (!order.length) return;
    const now = order.indexOf(state.chosen);
    state.chosen = order[(now + by + order.length) % order.length];
    if (now < 0) state.chosen = by > 0 ? order[0] : order[order.length - 1];
    centreOn(state.chosen);
    draw();
    describe();
  }

  function keys(event) {
    const moves = { ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] };
    const acts = { "+": () => zoom(1.5), "=": () => zoom(1.5), "-": () => zoom(1 / 1.5), n: () => step(1), p: () => step(-1), 0: () => { fit(); draw(); } };
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
      if (!mouse) return;
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
  }

  const legend = el("ul", { class: "legend" },
    [["hit", "○ hit: footprint"], ["miss", "× miss: footprint"], ["chosen", "chosen query"], ...(section.track === "retrieval" ? [["tile", "tile ranked first"]] : [])]
      .map(([name, text]) => el("li", {}, el("span", { class: `swatch ${name}` }), text)));
  new ResizeObserver(() => { if (!state.picture || !canvas.clientWidth) return;
    if (state.moved) resize();
    else fit();
    draw(); }).observe(canvas);
  load(0, -1);
  const shownTicks = section.track === "retrieval" ? ticks : ticks.slice(0, 2);
  return panel(section, "map", "Map", el("div", { class: "controls" }, scene.node, method.node, score.node, shownTicks.map((made) => made.node)),
    el("div", { class: "controls" }, buttons), el("div", { class: "map" }, el("div", {}, canvas, legend, status), info));
}
