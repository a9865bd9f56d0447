const ROW = 30;
const SPARE = 8;

// What the table of queries needs, unpacked once. Ids and texts come sorted: rows and codes order them.
async function loadQueries(section) {
  const packed = section.queries;
  if (packed.loaded) return packed.loaded;
  const ids = await unpack(packed.ids);
  const scene = await unpack(packed.scene);
  const conditions = await Promise.all(packed.conditions.map(loadColumn));
  packed.loaded = { ids, scene, conditions, scores: new Map() };
  return packed.loaded;
}

async function loadColumn(packed) {
  const values = packed.numeric === false ? packed.values : packed.values.map(number);
  return { ...packed, values, codes: await unpack(packed.codes) };
}

async function loadScore(section, score) {
  const loaded = await loadQueries(section);
  if (!loaded.scores.has(score.key)) loaded.scores.set(score.key, await loadColumn(section.queries.scores[score.key]));
  return loaded.scores.get(score.key);
}

function valueOf(section, column, method, row) {
  return column.values[column.codes[method * section.queries.count + row]];
}

// Whether a score only says hit or miss.
function isHit(column) {
  return column.values.every((value) => value === 0 || value === 1);
}

function queriesView(section, open) {
  const state = { text: "", scene: -1, outcome: "all", show: null, sort: null, descending: false, limits: new Map(), selected: -1 };
  const status = el("p", { class: "note", role: "status" });
  const head = el("div", { class: "grid-head", role: "row" });
  const body = el("div", { class: "grid-body", role: "rowgroup" });
  const grid = el("div", { class: "grid", role: "grid", tabindex: "0", "aria-label": "Queries: arrows move, Enter opens",
    onkeydown: keys, onscroll: paint }, head, body);
  const detail = el("div", { "aria-live": "polite" });
  let columns = [];
  let rows = new Int32Array(0);

  const scores = section.queryScores;
  const hitScore = scores.find((score) => isHit(section.queries.scores[score.key]));
  const shows = [
    ...(section.methods.length > 1 ? scores.map((score, index) => [`s${index}`, `${headingOfOne(score)} of all methods`]) : []),
    ...section.methods.map((method, index) => [`m${index}`, `All scores of ${method.name}`]),
  ];
  state.show = shows[0][0];
  const text = field("Queries that contain", "search", (value) => { state.text = value.toLowerCase(); refresh(); });
  const scene = choice("Scene", [[-1, "All"], ...section.scenes.map((found, index) => [index, found.title])], (value) => { state.scene = Number(value); refresh(); });
  const show = choice("Columns", shows, (value) => { state.show = value; state.sort = null; refresh(); });
  const outcome = choice("Outcome", [["all", "All queries"]], (value) => { state.outcome = value; refresh(); });
  const more = el("details", { class: "no-print" }, el("summary", {}, "Filter by condition"));
  open.queries = (place) => { state.scene = place; scene.select.value = String(place); goTo(section, "queries"); refresh(); };

  async function start() {
    const loaded = await loadQueries(section);
    if (hitScore) {
      const title = hitScore.title;
      const options = section.methods.length > 1
        ? [["none", `No method hits (${title})`], ["some", `Methods disagree (${title})`], ["every", `All methods hit (${title})`]]
        : [["none", `Misses (${title})`], ["every", `Hits (${title})`]];
      outcome.select.append(...options.map(([value, name]) => option(value, name)));
    }
    more.append(el("div", { class: "controls" }, loaded.conditions.flatMap((column) => conditionFilter(column))));
    if (!loaded.conditions.length) more.remove();
    refresh();
  }

  function conditionFilter(column) {
    if (column.numeric) {
      return [["from", 0], ["to", 1]].map(([word, side]) => {
        const made = field(`${column.title}, ${word}`, "number", (value) => {
          const limits = state.limits.get(column.name) || [-Infinity, Infinity];
          limits[side] = value === "" ? (side ? Infinity : -Infinity) : Number(value);
          state.limits.set(column.name, limits);
          refresh();
        });
        made.input.step = "any";
        return made.node;
      });
    }
    const options = [["", "All"], ...column.values.map((value, code) => [code, value === "" ? "unknown" : value])];
    return [choice(column.title, options, (value) => { state.limits.set(column.name, value === "" ? null : Number(value)); refresh(); }).node];
  }

  async function refresh() {
    const loaded = await loadQueries(section);
    const first = await loadScore(section, hitScore || scores[0]);
    columns = await makeColumns(loaded);
    const found = [];
    for (let row = 0; row < section.queries.count; row += 1) if (passes(loaded, first, row)) found.push(row);
    rows = Int32Array.from(found);
    sortRows();
    drawHead();
    status.textContent = `${rows.length.toLocaleString("en")} of ${section.queries.count.toLocaleString("en")} queries`;
    grid.setAttribute("aria-rowcount", String(rows.length + 1));
    grid.scrollTop = 0;
    paint();
  }

  function passes(loaded, first, row) {
    if (state.scene >= 0 && loaded.scene[row] !== state.scene) return false;
    if (state.text && !loaded.ids[row].toLowerCase().includes(state.text)) return false;
    for (const column of loaded.conditions) {
      const wanted = state.limits.get(column.name);
      if (wanted === undefined || wanted === null) continue;
      const code = column.codes[row];
      if (!column.numeric && code !== wanted) return false;
      // An unknown value passes only where no limit is set.
      if (column.numeric && (wanted[0] > -Infinity || wanted[1] < Infinity) && !(column.values[code] >= wanted[0] && column.values[code] <= wanted[1])) return false;
    }
    if (state.outcome === "all") return true;
    const hits = section.methods.filter((_, method) => valueOf(section, first, method, row) === 1).length;
    if (state.outcome === "none") return hits === 0;
    if (state.outcome === "every") return hits === section.methods.length;
    return hits > 0 && hits < section.methods.length;
  }

  async function makeColumns(loaded) {
    const made = [{ title: "Query", width: "16rem", value: (row) => row, show: (row) => loaded.ids[row] }];
    const index = Number(state.show.slice(1));
    const pairs = state.show[0] === "s" ? section.methods.map((method, number) => [method.name, scores[index], number])
      : scores.map((score) => [headingOfOne(score), score, index]);
    for (const [title, score, method] of pairs) {
      const column = await loadScore(section, score);
      made.push({ title, width: "8.5rem", number: true, bestFirst: score.higher, value: (row) => valueOf(section, column, method, row),
        show: (row) => (isHitCached(column) ? (valueOf(section, column, method, row) ? "✓ hit" : "✗ miss") : shown(score, valueOf(section, column, method, row))) });
    }
    for (const column of loaded.conditions) {
      made.push({ title: column.title, width: "8.5rem", number: column.numeric,
        value: (row) => (column.numeric ? column.values[column.codes[row]] : column.codes[row]),
        show: (row) => (column.numeric ? String(column.values[column.codes[row]]).replace("NaN", "–") : column.values[column.codes[row]]) });
    }
    return made;
  }

  function isHitCached(column) {
    if (column.hit === undefined) column.hit = isHit(column);
    return column.hit;
  }

  function sortRows() {
    if (state.sort === null) return;
    const keys = new Array(section.queries.count);
    for (const row of rows) keys[row] = columns[state.sort].value(row);
    rows.sort((one, other) => compare(keys[one], keys[other], state.descending) || one - other);
  }

  function drawHead() {
    const template = columns.map((column) => column.width).join(" ");
    body.style.height = `${rows.length * ROW}px`;
    head.style.gridTemplateColumns = template;
    body.dataset.columns = template;
    head.replaceChildren(...columns.map((column, index) => el("div", { role: "columnheader", class: column.number ? "number" : null,
      "aria-sort": state.sort !== index ? "none" : state.descending ? "descending" : "ascending" },
    el("button", { type: "button", title: column.title, onclick: () => {
      state.descending = state.sort === index ? !state.descending : Boolean(column.bestFirst);
      state.sort = index;
      sortRows(); drawHead(); paint();
      head.children[index].firstChild.focus();
    } }, column.title))));
  }

  function paint() {
    const first = Math.max(0, Math.floor(grid.scrollTop / ROW) - SPARE);
    const last = Math.min(rows.length, Math.ceil((grid.scrollTop + grid.clientHeight) / ROW) + SPARE);
    const drawn = [];
    for (let place = first; place < last; place += 1) {
      const row = rows[place];
      const made = el("div", { class: "grid-row", role: "row", "aria-rowindex": place + 2, "aria-selected": String(row === state.selected), onclick: () => choose(place) },
        columns.map((column) => el("div", { role: "gridcell", class: column.number ? "number" : null, title: column.show(row) }, column.show(row))));
      made.style.top = `${place * ROW}px`;
      made.style.gridTemplateColumns = body.dataset.columns;
      drawn.push(made);
    }
    body.replaceChildren(...drawn);
  }

  function keys(event) {
    if (event.target !== grid) return;
    const page = Math.max(1, Math.floor(grid.clientHeight / ROW) - 2);
    const steps = { ArrowDown: 1, ArrowUp: -1, PageDown: page, PageUp: -page, Home: -rows.length, End: rows.length };
    const now = rows.indexOf(state.selected);
    if (event.key in steps && rows.length) {
      event.preventDefault();
      const next = Math.min(rows.length - 1, Math.max(0, now + steps[event.key]));
      state.selected = rows[next];
      if (next * ROW < grid.scrollTop) grid.scrollTop = next * ROW;
      const below = (next + 3) * ROW - grid.clientHeight;
      if (below > grid.scrollTop) grid.scrollTop = below;
      paint();
    } else if (event.key === "Enter" && now >= 0) {
      event.preventDefault();
      choose(now);
    }
  }

  async function choose(place) {
    state.selected = rows[place];
    paint();
    detail.replaceChildren(await queryDetail(section, state.selected, open));
  }

  start();
  return panel(section, "queries", "Queries", el("div", { class: "controls" }, text.node, scene.node, outcome.node, show.node), more, status, grid,
    el("p", { class: "note" }, "Values of queries are kept to four digits. Arrow keys move in the table, Enter opens a query."), detail);
}

async function queryDetail(section, row, open) {
  const loaded = await loadQueries(section);
  const columns = await Promise.all(section.queryScores.map((score) => loadScore(section, score)));
  const facts = Object.fromEntries([["Scene", section.scenes[loaded.scene[row]].title],
    ...loaded.conditions.map((column) => [column.title, String(column.values[column.codes[row]])])]);
  const table = sortableTable("Scores of this query", [methodColumn(), ...scoreColumns(section,
    section.queryScores.map((score) => section.scores.findIndex((other) => other.key === score.key)),
    (found, index) => valueOf(section, columns[section.queryScores.findIndex((score) => score.key === section.scores[index].key)], found.index, row),
    () => null, headingOfOne, false)], methodRows(section));
  const place = loaded.scene[row];
  const onMap = section.maps.some((map) => map.scene === section.scenes[place].id);
  const pictures = (section.hardest.find((found) => found.row === row) || { pictures: [] }).pictures;
  return el("div", { class: "drill" }, el("h4", {}, loaded.ids[row]), keyList(facts), pictureRow(pictures),
    onMap && open.map ? el("div", { class: "controls no-print" }, el("button", { type: "button", onclick: () => open.map(place, row) }, "Show it on the map")) : null, table.node);
}

function pictureRow(pictures) {
  if (!pictures.length) return null;
  return el("div", { class: "pictures" }, pictures.map((picture) =>
    el("figure", {}, el("img", { src: picture.src, alt: picture.title }), el("figcaption", {}, picture.title))));
}

function hardestView(section, open) {
  const list = el("ol", { class: "cards" });
  (async () => {
    const loaded = await loadQueries(section);
    const first = section.queryScores[0];
    const column = await loadScore(section, first);
    list.replaceChildren(...section.hardest.map((found) => {
      const values = section.methods.map((_, method) => valueOf(section, column, method, found.row));
      const said = isHit(column) ? `${first.title}: hit by ${values.filter((value) => value === 1).length} of ${values.length} methods`
        : `${first.ofOne}: ${values.map((value) => shown(first, value)).join(", ")}`;
      const more = el("details", {}, el("summary", {}, "Scores"));
      more.addEventListener("toggle", async () => {
        if (more.children.length === 1) more.append(await queryDetail(section, found.row, open));
      });
      return el("li", { class: "card" }, el("h4", {}, loaded.ids[found.row]), pictureRow(found.pictures), el("p", {}, said), more);
    }));
  })();
  return panel(section, "hardest", "Hardest queries",
    el("p", { class: "note" }, `Worst first, by the mean over methods of ${section.queryScores[0].ofOne}${section.queryScores[0].unit === "share" ? ", then by the error" : ""}.`), list);
}
