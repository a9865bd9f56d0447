const ROW = matchMedia("(pointer: coarse), (max-width: 30rem)").matches ? 44 : 30; // as in style.css
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
  return { ...packed, values, texts: packed.texts ? await unpack(packed.texts) : values, codes: await unpack(packed.codes) };
}

async function loadScore(section, score) {
  const loaded = await loadQueries(section);
  if (!loaded.scores.has(score.key)) loaded.scores.set(score.key, await loadColumn(section.queries.scores[score.key]));
  return loaded.scores.get(score.key);
}

function valueOf(section, column, method, row) {
  return column.values[column.codes[method * section.queries.count + row]];
}

// The same as it is written.
function textOf(section, column, method, row) {
  return column.texts[column.codes[method * section.queries.count + row]];
}

function queriesView(section) {
  const state = { text: "", scene: -1, outcome: "all", show: null, sort: null, descending: false, limits: new Map(), selected: -1 };
  const status = el("p", { class: "note", role: "status" });
  const head = el("div", { class: "grid-head", role: "row" });
  const body = el("div", { class: "grid-body", role: "rowgroup" });
  const grid = el("div", { class: "grid", role: "grid", tabindex: "0", "aria-label": "Queries: arrows move, Enter opens",
    onkeydown: keys, onscroll: paint }, head, body);
  const onPaper = el("p", { class: "note only-print" }, `Single queries are listed on the screen only.`);
  const detail = el("div", {});
  let columns = [];
  let rows = new Int32Array(0);

  const scores = section.queryScores;
  const hitScore = scores.find((score) => score.isHit);
  const shows = [
    ...(section.methods.length > 1 ? scores.map((score, index) => [`s${index}`, `${score.headingOfOne} of all methods`]) : []),
    ...section.methods.map((method, index) => [`m${index}`, `All scores of ${method.name}`]),
  ];
  state.show = shows[0][0];
  const text = field("Queries that contain", "search", (value) => { state.text = value.toLowerCase(); refresh(); });
  const scene = choice("Scene", [[-1, "All"], ...section.scenes.map((found, index) => [index, found.title])], (value) => { state.scene = Number(value); refresh(); });
  const show = choice("Columns", shows, (value) => { state.show = value; state.sort = null; refresh(); });
  const outcome = choice("Outcome", [["all", "All queries"]], (value) => { state.outcome = value; refresh(); });
  const more = el("details", { class: "no-print" }, el("summary", {}, "Filter by condition"));
  section.listScene = (place) => { state.scene = place; scene.select.value = String(place); jump(addressOf(section, "queries")); goTo(section, "queries"); refresh(); };
  section.open.query = async (id) => {
    const loaded = await loadQueries(section);
    const row = loaded.ids.indexOf(id);
    if (row < 0) { detail.replaceChildren(unknown(section, "queries", `This part has no query ${id}.`)); return; }
    state.selected = row;
    bringIntoView(rows.indexOf(row));
    await showChosen();
  };
  section.close.query = () => { detail.replaceChildren(); state.selected = -1; paint(); };

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
    await refresh();
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
    const options = [["", "All"], ...column.values.map((value, code) => [code, value])];
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
    status.textContent = `${rows.length.toLocaleString("en")} of ${section.queries.count.toLocaleString("en")} ${section.queries.count === 1 ? "query" : "queries"}`;
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
    const longest = loaded.ids.reduce((most, id) => Math.max(most, id.length), 0);
    const made = [{ title: "Query", width: `min(var(--most-id), ${Math.max(8, 0.56 * longest + 1.6)}rem)`, value: (row) => row, show: (row) => loaded.ids[row] }];
    const index = Number(state.show.slice(1));
    const pairs = state.show[0] === "s" ? section.methods.map((method, number) => [method.name, scores[index], number])
      : scores.map((score) => [score.headingOfOne, score, index]);
    for (const [title, score, method] of pairs) {
      const column = await loadScore(section, score);
      made.push({ title, width: widthOf(title, 8), number: true, bestFirst: score.higher, value: (row) => valueOf(section, column, method, row),
        show: (row) => textOf(section, column, method, row) });
    }
    for (const column of loaded.conditions) {
      const longest = column.numeric ? 7 : Math.max(...column.values.map((value) => value.length), 0);
      made.push({ title: column.title, width: widthOf(column.title, longest), number: column.numeric,
        value: (row) => (column.numeric ? column.values[column.codes[row]] : column.codes[row]),
        show: (row) => column.texts[column.codes[row]] });
    }
    return made;
  }

  // Room for the longest word of a heading and for its values.
  function widthOf(title, longest) {
    const word = Math.max(...title.split(" ").map((part) => part.length));
    return `${Math.min(16, Math.max(6, 0.62 * Math.max(word, longest) + 2.4))}rem`;
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
    const painted = [];
    for (let place = first; place < last; place += 1) {
      const row = rows[place];
      const made = el("div", { class: "grid-row", role: "row", id: `${section.id}-row-${row}`, "aria-rowindex": place + 2, "aria-selected": String(row === state.selected), onclick: () => choose(place) },
        columns.map((column, index) => el("div", { role: index ? "gridcell" : "rowheader", class: column.number ? "number" : null, title: column.show(row) },
          index ? column.show(row) : el("span", {}, column.show(row)))));
      made.style.top = `${place * ROW}px`;
      made.style.height = `${ROW}px`;
      made.style.gridTemplateColumns = body.dataset.columns;
      painted.push(made);
    }
    body.replaceChildren(...painted);
    const chosen = document.getElementById(`${section.id}-row-${state.selected}`);
    if (chosen) grid.setAttribute("aria-activedescendant", chosen.id);
    else grid.removeAttribute("aria-activedescendant");
  }

  function bringIntoView(place) {
    if (place < 0) return;
    if (place * ROW < grid.scrollTop) grid.scrollTop = place * ROW;
    const below = (place + 1) * ROW + head.offsetHeight + 16 - grid.clientHeight;
    if (below > grid.scrollTop) grid.scrollTop = below;
    paint();
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
      bringIntoView(next);
    } else if (event.key === "Enter" && now >= 0) {
      event.preventDefault();
      choose(now);
    } else if (event.key === "Escape" && detail.firstChild) {
      leave();
    }
  }

  async function choose(place) {
    state.selected = rows[place];
    const loaded = await loadQueries(section);
    visit(addressOf(section, "query", loaded.ids[state.selected]));
    await showChosen();
  }

  async function showChosen() {
    paint();
    const row = state.selected;
    const id = (await loadQueries(section)).ids[row];
    const parts = await queryDetail(section, row);
    if (state.selected !== row) return;
    const { box, head: title } = drillBox(`${section.id}-query`, id, leave,
      el("div", { class: "controls no-print" }, mapButton(section, row), el("button", { type: "button", onclick: leave }, "Close")),
      pictureRow(section, row), ...parts);
    detail.replaceChildren(box);
    reveal(box, title);
  }

  function leave() {
    visit(addressOf(section, "queries"));
    detail.replaceChildren();
    reveal(grid, grid);
  }

  drawn.push(start());
  return panel(section, "queries", "Queries", el("div", { class: "controls" }, text.node, scene.node, outcome.node, show.node), more, status, grid, onPaper,
    el("p", { class: "note" }, "Values of queries are kept to four digits. Arrow keys move in the table, Enter opens a query, Escape closes it. The address names the open query, to be sent."), detail);
}

