// The tiles that a method retrieved for a query: where they are, their ranks, which are hits.
const TILE_HIT = "#f0e442";
const TILE_MISS = "#ff9de2";

async function loadTiles(map) {
  if (!map.tiles) return null;
  const [ids, outlines, codes, bits] = await Promise.all([map.tiles, map.tileOutlines, map.ranked, map.hits].map(unpack));
  return { ids, outlines, codes, bits, ranks: map.ranks };
}

// The first tiles of a list, best first; place is the query's on its map.
function tilesOf(tiles, methods, queries, method, place) {
  if (!tiles) return [];
  const found = [];
  for (let rank = 0; rank < tiles.ranks; rank += 1) {
    const tile = tiles.codes[(rank * methods + method) * queries + place];
    if (tile >= tiles.ids.length) continue;
    found.push({ tile, rank: rank + 1, id: tiles.ids[tile], hit: Boolean((tiles.bits[method * queries + place] >> rank) & 1) });
  }
  return found;
}

function saidHit(hit) {
  return hit ? "✓ hit" : "✗ miss";
}

function tilesList(section, method, found, show, outlined) {
  if (!found.length) return el("p", { class: "note" }, `The records of ${method.name} name no tile for this query.`);
  const hits = found.filter((one) => one.hit).length;
  const rows = found.map((one) => el("tr", {}, el("td", {}, String(one.rank)),
    el("td", { class: "text" }, el("button", { type: "button", class: "link", title: "Show it on the map", onclick: () => show(one.tile) }, one.id)),
    el("td", { class: "text" }, el("span", { class: one.hit ? "said-hit" : "said-miss" }, saidHit(one.hit)))));
  return el("div", {},
    el("table", { class: "tiles" }, el("caption", {}, `First tiles of ${method.name}: ${hits} of ${found.length} answer${found.length === 1 ? "s" : ""} the query`),
      el("thead", {}, el("tr", {}, ["Rank", "Tile", ""].map((text, index) => el("th", { scope: "col", class: index ? "text" : null }, text || spoken("Hit or miss"))))),
      el("tbody", {}, rows)),
    hits ? null : el("p", { class: "note" }, `None of them is a positive. ${outlined ? "The white outline is what the photo shows of the ground." : "The white circle is where the photo looks; its outline is not known."}`));
}

// A tile's badge stands in the corner of the tile, and those of one place stand side by side.
function tileBadges(context, corners, found, pixel) {
  const taken = [];
  const [width, height] = [34 * pixel, 18 * pixel];
  context.font = `bold ${12 * pixel}px sans-serif`;
  context.textBaseline = "middle";
  found.forEach((one, index) => {
    let [x, y] = corners[index];
    while (taken.some(([ox, oy]) => Math.abs(ox - x) < width && Math.abs(oy - y) < height)) x += width + 2 * pixel;
    taken.push([x, y]);
    context.fillStyle = "#000";
    context.fillRect(x, y, width, height);
    context.fillStyle = one.hit ? TILE_HIT : TILE_MISS;
    context.fillText(`${one.rank} ${one.hit ? "✓" : "✗"}`, x + 5 * pixel, y + height / 2);
  });
}
