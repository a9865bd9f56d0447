// A scene's map: footprints with hits and misses, first tiles, arrows of errors.
const INK = {
  hit: "#56b4e9",
  miss: "#ff7f2a",
  tileHit: "#f0e442",
  tileMiss: "#ff9de2",
  arrow: "#e69f00",
  chosen: "#fff",
};

function mapView({ part, table, state, isHit, choose, rows }, box) {
  const canvas = box.querySelector(".map");
  const context = canvas.getContext("2d");
  const view = { x: 0, y: 0, scale: 0, map: null, method: -1, hovered: -1 };

  async function load(place = 0) {
    const map = part.maps[place];
    const keys = ["rows", "outlines", "centres", "tiles", "tileOutlines", "ranked", "hits", "tips"];
    const found = await Promise.all(keys.map((key) => (map[key] ? unpack(map[key]) : null)));
    const picture = new Image();
    await new Promise((done) => {
      picture.onload = done;
      picture.src = page.pictures[map.picture];
    });
    view.map = { ...map, ...Object.fromEntries(keys.map((key, n) => [key, found[n]])) };
    Object.assign(view.map, { image: picture, place });
    canvas.style.aspectRatio = Math.min(1.6, Math.max(0.8, map.width / map.height));
    view.method = -1;
    view.map.placeOf = new Map([...view.map.rows].map((row, at) => [row, at]));
    fit();
  }

  // Shows where the queries are, or all of the map.
  function fit(whole = false) {
    const { map } = view;
    if (!map || !canvas.clientWidth) return;
    const seen = [...map.rows.keys()].map((place) => point(map.centres, place));
    const ends = [[0, 0], [map.width, map.height]]; // prettier-ignore
    frame(whole || seen.every(([x]) => Number.isNaN(x)) ? ends : seen, whole ? 1 : 0.85);
    if (!whole) fill();
  }

  // Moves the map so that points fill a share of the canvas.
  function frame(points, share) {
    const known = points.filter(([x]) => !Number.isNaN(x));
    if (known.length && canvas.clientWidth) {
      const [left, top] = [0, 1].map((axis) => Math.min(...known.map((one) => one[axis])));
      const [right, foot] = [0, 1].map((axis) => Math.max(...known.map((one) => one[axis])));
      const fits = [canvas.clientWidth / (right - left), canvas.clientHeight / (foot - top)];
      view.scale = Math.min(1.5, ...fits.map((one) => one * share));
      view.x = canvas.clientWidth / 2 - ((left + right) / 2) * view.scale;
      view.y = canvas.clientHeight / 2 - ((top + foot) / 2) * view.scale;
    }
    draw();
  }

  // Leaves no empty bars beside the map where a little more zoom fills them.
  function fill() {
    const sides = [canvas.clientWidth, canvas.clientHeight];
    const wanted = Math.max(sides[0] / view.map.width, sides[1] / view.map.height);
    const factor = wanted / view.scale;
    if (factor > 1 && factor < 1.3) zoom(factor);
    const inside = (at, space) => Math.min(Math.max(0, space), Math.max(Math.min(0, space), at));
    view.x = inside(view.x, sides[0] - view.map.width * view.scale);
    view.y = inside(view.y, sides[1] - view.map.height * view.scale);
    draw();
  }

  function point(array, place) {
    const pair = [array[2 * place], array[2 * place + 1]];
    return pair.map((step) => (step === view.map.nowhere ? NaN : step / view.map.stepsPerPixel));
  }

  const corners = (array, place) => [0, 1, 2, 3].map((n) => point(array, 4 * place + n));

  // The first tiles of the method's list for a query, best first.
  function tilesAt(place) {
    const { map } = view;
    const found = [];
    for (let rank = 0; rank < (map.ranks || 0); rank += 1) {
      const lists = part.methods.length * map.rows.length;
      const at = state.method * map.rows.length + place;
      const tile = map.ranked[rank * lists + at];
      const hit = Boolean((map.hits[at] >> rank) & 1);
      if (tile < map.tiles.length) found.push({ rank: rank + 1, id: map.tiles[tile], tile, hit });
    }
    return found;
  }

  function draw() {
    const { map } = view;
    if (!map) return;
    if (view.method !== state.method) legend();
    const ratio = canvas.width / canvas.clientWidth;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
    context.translate(view.x, view.y);
    context.scale(view.scale, view.scale);
    context.drawImage(map.image, 0, 0, map.width, map.height);
    const places = rows().flatMap((row) => (map.placeOf.has(row) ? [map.placeOf.get(row)] : []));
    const chosen = map.placeOf.get(state.chosen) ?? -1;
    context.globalAlpha = chosen < 0 ? 1 : 0.7;
    for (const place of places) drawQuery(place, isHit(map.rows[place]));
    context.globalAlpha = 1;
    if (chosen >= 0) drawChosen(chosen);
    const hovered = map.placeOf.get(view.hovered) ?? -1;
    if (hovered >= 0) drawFootprint(hovered, 2);
    drawScale(ratio);
  }

  function outline(points, ink, width, dashes = []) {
    if (points.some(([x]) => Number.isNaN(x))) return;
    const pixel = 1 / view.scale;
    context.beginPath();
    points.forEach(([x, y]) => context.lineTo(x, y));
    if (points.length > 2) context.closePath();
    context.setLineDash([]);
    context.lineWidth = (width + 2) * pixel;
    context.strokeStyle = "#0008";
    context.stroke();
    context.setLineDash(dashes.map((length) => length * pixel));
    context.lineWidth = width * pixel;
    context.strokeStyle = ink;
    context.stroke();
    context.setLineDash([]);
  }

  function drawQuery(place, hit) {
    const { map } = view;
    const [x, y] = point(map.centres, place);
    const r = 4 / view.scale;
    if (hit) {
      outline(ring([x, y], r), INK.hit, 2);
    } else {
      outline(
        [
          [x - r, y - r],
          [x + r, y + r],
        ],
        INK.miss,
        2,
      );
      outline(
        [
          [x + r, y - r],
          [x - r, y + r],
        ],
        INK.miss,
        2,
      );
    }
    if (map.tips) drawArrow([x, y], point(map.tips, state.method * map.rows.length + place));
  }

  function ring([x, y], radius) {
    const turns = [...Array(13).keys()].map((n) => (n * Math.PI) / 6);
    return turns.map((turn) => [x + radius * Math.cos(turn), y + radius * Math.sin(turn)]);
  }

  // A ring where the footprint is not known.
  function drawFootprint(place, width) {
    const { outlines, centres, rows: all } = view.map;
    const known = corners(outlines, place);
    const unknown = known.some(([x]) => Number.isNaN(x));
    const shape = unknown ? ring(point(centres, place), 12 / view.scale) : known;
    outline(shape, INK.chosen, width + 3);
    outline(shape, isHit(all[place]) ? INK.hit : INK.miss, width);
  }

  function drawArrow([x, y], [left, top]) {
    const turn = Math.atan2(top - y, left - x);
    const side = (by) => [
      left - (8 / view.scale) * Math.cos(turn + by),
      top - (8 / view.scale) * Math.sin(turn + by),
    ];
    outline(
      [
        [x, y],
        [left, top],
      ],
      INK.arrow,
      2,
    );
    outline([side(0.5), [left, top]], INK.arrow, 2);
    outline([side(-0.5), [left, top]], INK.arrow, 2);
  }

  function drawChosen(place) {
    const { map } = view;
    const size = 12 / view.scale;
    context.font = `bold ${size}px sans-serif`;
    for (const { tile, rank, hit } of tilesAt(place).reverse()) {
      const shape = corners(map.tileOutlines, tile);
      outline(shape, hit ? INK.tileHit : INK.tileMiss, 1.5, hit ? [] : [7, 5]);
      const [x, y] = shape[3];
      context.fillStyle = "#000";
      context.fillRect(x, y, 2.6 * size, 1.4 * size);
      context.fillStyle = hit ? INK.tileHit : INK.tileMiss;
      context.fillText(`${rank} ${hit ? "✓" : "✗"}`, x + 0.3 * size, y + 1.1 * size);
    }
    drawFootprint(place, 3);
    drawQuery(place, isHit(map.rows[place]));
  }

  function drawScale(ratio) {
    const metres = view.map.metresPerPixel / view.scale;
    const round = 10 ** Math.floor(Math.log10(metres * 150));
    const length = [5, 2, 1].map((factor) => factor * round).find((one) => one <= metres * 150);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const top = canvas.clientHeight - 14;
    context.fillStyle = "#fffd";
    context.fillRect(6, top - 20, length / metres + 12, 28);
    context.fillStyle = "#000";
    context.fillRect(12, top, length / metres, 3);
    context.font = "12px sans-serif";
    context.fillText(`${length} m`, 12, top - 5);
  }

  function zoom(factor, x = canvas.clientWidth / 2, y = canvas.clientHeight / 2) {
    view.x = x - (x - view.x) * factor;
    view.y = y - (y - view.y) * factor;
    view.scale *= factor;
    draw();
  }

  function drag(dx, dy) {
    view.x += dx;
    view.y += dy;
    draw();
  }

  function nearest(x, y, within = Infinity) {
    let [least, found] = [within, -1];
    for (const row of rows()) {
      const place = view.map.placeOf.get(row);
      if (place === undefined) continue;
      const [px, py] = point(view.map.centres, place);
      const away = Math.hypot(px * view.scale + view.x - x, py * view.scale + view.y - y);
      if (away < least) [least, found] = [away, row];
    }
    return found;
  }

  function step(by) {
    const order = rows().filter((row) => view.map.placeOf.has(row));
    if (!order.length) return;
    const now = order.indexOf(state.chosen);
    choose(order[now < 0 ? 0 : (now + by + order.length) % order.length]);
  }

  // Shows a query with its tiles and arrow; one of another scene brings the map of its scene.
  async function focus(row, closer) {
    if (row < 0) return draw();
    const scene = table.scene[row];
    const other = part.maps.findIndex((map) => map.scene === scene);
    if (other >= 0 && other !== view.map.place) await load(other);
    const place = view.map.placeOf.get(row);
    if (place === undefined || !closer) return draw();
    const { centres, outlines, tileOutlines, tips, rows: all } = view.map;
    const ends = [point(centres, place), ...corners(outlines, place)];
    ends.push(...tilesAt(place).flatMap(({ tile }) => corners(tileOutlines, tile)));
    if (tips) ends.push(point(tips, state.method * all.length + place));
    return frame(ends, 0.8);
  }

  function tilesOf(row) {
    const place = view.map?.placeOf.get(row);
    if (place === undefined || !view.map.ranks) return null;
    const found = tilesAt(place);
    if (!found.length) return null;
    const said = found.map(({ rank, id, hit }) =>
      el(
        "li",
        { class: hit ? "said-hit" : "said-miss" },
        `${rank} ${id} ${hit ? "✓ hit" : "✗ miss"}`,
      ),
    );
    const title = el("p", { class: "note" }, `First tiles of ${part.methods[state.method]}:`);
    return el("div", {}, title, el("ul", { class: "tiles" }, said));
  }

  function legend() {
    const { factor, ranks, rows: all } = view.map;
    const first = state.method * all.length;
    const arrows = factor && [...all.keys()].some((n) => point(view.map.tips, first + n)[0] > -1e9);
    view.method = state.method;
    const marks = [
      ["hit", ranks ? "○ hit; pointed at: its footprint" : "○ hit"],
      ["miss", "× miss"],
    ];
    if (ranks)
      marks.push(
        ["tile-hit", "✓ retrieved tile that answers"],
        ["tile-miss", "✗ one that does not"],
      );
    if (arrows) marks.push(["arrow", `error, true to estimated place, × ${factor}`]);
    const items = marks.map(([name, text]) =>
      el("li", {}, el("span", { class: `swatch ${name}` }), text),
    );
    box.querySelector(".map-legend").replaceChildren(...items);
  }

  const keys = { n: () => step(1), p: () => step(-1), 0: () => fit(true), Escape: () => choose(-1) };
  movable(canvas, { drag, zoom, click: (x, y) => choose(nearest(x, y)), keys });
  canvas.addEventListener("pointermove", (event) => {
    const found = view.map ? nearest(event.offsetX, event.offsetY, 20) : -1;
    if (found === view.hovered) return;
    view.hovered = found;
    draw();
  });
  fitted(canvas, () => (view.scale ? draw() : fit()));
  const acts = {
    "+": () => zoom(1.5),
    "−": () => zoom(1 / 1.5),
    Whole: () => fit(true),
    Previous: keys.p,
    Next: keys.n,
  };
  const buttons = Object.entries(acts).map(([name, act]) => button(name, act));
  if (part.maps.length > 1) {
    const titles = part.maps.map((map, place) => [place, part.scenes[map.scene]]);
    buttons.unshift(choice("Map", titles, (place) => load(Number(place))).node);
  }
  box.querySelector(".map-buttons").append(...buttons);
  return { load, draw, focus, tilesOf };
}
