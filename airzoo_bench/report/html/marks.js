// What a scene's map draws: footprints with hits and misses of a method, and retrieved tiles.
const HIT = "#56b4e9";
const MISS = "#ff7f2a";

// Where things are on the map of a state, in pixels of its picture, and what is to be drawn.
function mapPlaces(section, state) {
  function point(array, place) {
    const map = section.maps[state.map];
    const [x, y] = [array[2 * place], array[2 * place + 1]];
    return x === map.nowhere || y === map.nowhere ? [NaN, NaN] : [x / map.stepsPerPixel, y / map.stepsPerPixel];
  }

  function corners(array, place) {
    return [0, 1, 2, 3].map((corner) => point(array, 4 * place + corner));
  }

  // Without a score that says hit or miss, all queries are drawn alike.
  function isHit(place) {
    return !state.score || valueOf(section, state.column, state.method, state.rows[place]) === 1;
  }

  return { point, corners, isHit,
    centreOf: (place) => point(state.centres, place),
    outlineOf: (place) => corners(state.outlines, place),
    outlineOfTile: (tile) => corners(state.tiles.outlines, tile),
    isShown: (place) => (isHit(place) ? state.hits : state.misses),
    tilesAt: (place) => tilesOf(state.tiles, section.methods.length, state.rows.length, state.method, place) };
}

function mapPainter(section, canvas, state, places) {
  const context = canvas.getContext("2d");

  function resize() {
    state.ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * state.ratio);
    canvas.height = Math.round(canvas.clientHeight * state.ratio);
  }

  function draw() {
    if (!state.picture) return;
    if (canvas.width !== Math.round(canvas.clientWidth * state.ratio)) resize();
    const map = section.maps[state.map];
    context.setTransform(state.ratio, 0, 0, state.ratio, 0, 0);
    context.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
    context.translate(state.x, state.y);
    context.scale(state.scale, state.scale);
    context.drawImage(state.picture, 0, 0, map.width, map.height);
    // One finger scrolls the page over a whole map, and moves one that was zoomed.
    canvas.style.touchAction = state.moved ? "none" : "pan-y";
    const pixel = 1 / state.scale;
    if (state.tiles && state.first) drawFirstTiles(pixel);
    // Around a chosen query the others step back.
    context.globalAlpha = state.chosen < 0 ? 1 : 0.35;
    for (let place = 0; place < state.rows.length; place += 1) if (places.isShown(place)) drawQuery(place, pixel);
    context.globalAlpha = 1;
    if (state.chosen >= 0) drawChosen(pixel);
    drawScale();
  }

  function path(points) {
    if (points.some(([x]) => Number.isNaN(x))) return false;
    context.beginPath();
    points.forEach(([x, y]) => context.lineTo(x, y));
    context.closePath();
    return true;
  }

  function drawQuery(place, pixel) {
    const hit = places.isHit(place);
    context.setLineDash(hit ? [] : [5 * pixel, 4 * pixel]);
    context.lineWidth = 2 * pixel;
    context.strokeStyle = hit ? HIT : MISS;
    if (path(places.outlineOf(place))) context.stroke();
    context.setLineDash([]);
    const [x, y] = places.centreOf(place);
    const r = 4.5 * pixel;
    context.beginPath();
    if (hit) context.arc(x, y, r, 0, 7);
    else { context.moveTo(x - r, y - r); context.lineTo(x + r, y + r); context.moveTo(x + r, y - r); context.lineTo(x - r, y + r); }
    context.lineWidth = 4 * pixel; context.strokeStyle = "#000"; context.stroke();
    context.lineWidth = 2 * pixel; context.strokeStyle = hit ? HIT : MISS; context.stroke();
  }

  // The first tile of each query that is drawn, each once: one that answers any of them as such.
  function drawFirstTiles(pixel) {
    const found = new Map();
    for (let place = 0; place < state.rows.length; place += 1) {
      const [first] = places.tilesAt(place);
      if (first && first.rank === 1 && places.isShown(place)) found.set(first.tile, first.hit || Boolean(found.get(first.tile)));
    }
    // Those that answer lie above.
    const ordered = [...found].sort((one, other) => one[1] - other[1]);
    for (const [tile, hit] of ordered) if (path(places.outlineOfTile(tile))) strokeTile(hit, 1.5, pixel);
  }

  function strokeTile(hit, width, pixel) {
    context.lineWidth = width * pixel;
    context.setLineDash(hit ? [] : [7 * pixel, 5 * pixel]);
    context.strokeStyle = hit ? TILE_HIT : TILE_MISS;
    context.stroke();
    context.setLineDash([]);
  }

  function drawChosen(pixel) {
    const edge = () => { context.lineWidth = 6 * pixel; context.strokeStyle = "#000"; context.stroke(); context.lineWidth = 3 * pixel; };
    if (path(places.outlineOf(state.chosen))) { edge(); context.strokeStyle = "#fff"; context.stroke(); }
    const [x, y] = places.centreOf(state.chosen);
    context.beginPath(); context.arc(x, y, 8 * pixel, 0, 7); edge(); context.strokeStyle = "#fff"; context.stroke();
    const found = places.tilesAt(state.chosen);
    for (const one of [...found].reverse()) {
      if (!path(places.outlineOfTile(one.tile))) continue;
      edge();
      strokeTile(one.hit, 3, pixel);
    }
    tileBadges(context, found.map((one) => places.point(state.tiles.outlines, 4 * one.tile + 3)), found, pixel);
  }

  function drawScale() {
    const metres = section.maps[state.map].metresPerPixel / state.scale;
    const round = 10 ** Math.floor(Math.log10(metres * 150));
    const length = [5, 2, 1].map((factor) => factor * round).find((value) => value <= metres * 150);
    context.setTransform(state.ratio, 0, 0, state.ratio, 0, 0);
    const [x, y] = [12, canvas.clientHeight - 14];
    context.fillStyle = "rgba(255, 255, 255, 0.85)";
    context.fillRect(x - 6, y - 20, length / metres + 12, 28);
    context.fillStyle = "#000";
    context.fillRect(x, y, length / metres, 3);
    context.font = "12px sans-serif";
    context.fillText(`${length} m`, x, y - 5);
  }

  return { draw, resize };
}

function mapLegend(section, byHits) {
  const marks = byHits ? [["hit", "○ hit: footprint"], ["miss", "× miss: footprint"]] : [["hit", "○ footprint"]];
  marks.push(["chosen", "chosen query"]);
  if (section.maps.some((map) => map.tiles)) marks.push(["tile-hit", "✓ retrieved tile that answers its query"], ["tile-miss", "✗ one that does not"]);
  return el("ul", { class: "legend" }, marks.map(([name, text]) => el("li", {}, el("span", { class: `swatch ${name}` }), text)));
}
