function methodRows(section) {
  return section.methods.map((method, index) => ({ name: `${method.name}${method.mark}`, index }));
}

function methodColumn() {
  return { title: "Method", text: true, value: (row) => row.name, show: (row) => (row.hint ? el("span", { title: row.hint }, row.name) : row.name) };
}

// Methods, and below them what scores without one, which is of no view but tables of scores.
function rowsWithFloors(section, wanted) {
  const there = (floor) => wanted.some((index) => floor.overall.values[index] !== null);
  const floors = section.references.filter(there).map((floor) => ({ name: floor.name, hint: floor.meaning, floor }));
  return [...methodRows(section), ...floors];
}

// Columns of scores: values, texts and marks of a scope come as they were decided when the page was made.
function scoreColumns(section, wanted, scope, limits) {
  const { values, texts, marks } = scopeOf(section.standings, scope);
  const floorAt = (row, part, index) => scopeOf(row.floor, scope)[part][index];
  return wanted.map((index) => {
    const score = section.scores[index];
    return {
      title: score.heading,
      value: (row) => number(row.floor ? floorAt(row, "values", index) : values[row.index][index]),
      show: (row) => (row.floor ? floorAt(row, "texts", index) : [texts[row.index][index], interval((limits[score.key] || [])[row.index])]),
      mark: (row) => (row.floor ? "" : marks[row.index][index]),
      bestFirst: score.higher ? "descending" : "ascending",
      hint: score.meaning,
    };
  });
}

function interval(text) {
  return text ? el("span", { class: "interval", title: "95 % interval" }, text) : null;
}

function scopeOf(holder, scope) {
  return scope === "overall" || scope === "pooled" ? holder[scope] : holder.perScene[scope];
}

function limitsAt(section, scope) {
  if (scope === "overall") return section.intervals.overall;
  if (scope === "pooled") return {};
  return section.intervals.scenes[section.scenes[scope].id] || {};
}

function methodsTable(section, scope, every, caption) {
  const wanted = section.scores.flatMap((score, index) => (every || score.headline ? [index] : []));
  const columns = scoreColumns(section, wanted, scope, limitsAt(section, scope));
  return sortableTable(caption, [methodColumn(), ...columns], rowsWithFloors(section, wanted), "no method matches");
}

// What the titles of scores mean, for who does not know them.
function glossary(section, every, open) {
  const known = section.scores.filter((score) => (every || score.headline) && score.meaning);
  return el("details", { class: "glossary", open }, el("summary", {}, "What the scores mean"),
    el("dl", { class: "keys" }, known.flatMap((score) => [el("dt", {}, score.title), el("dd", {}, score.meaning)])));
}

function summaryView(section) {
  const state = { scope: "overall", every: false, filter: "" };
  const holder = el("div", {});
  const single = section.scenes.length === 1;
  const scopes = [["overall", single ? section.scenes[0].title : "Average over scenes"]];
  if (section.byQuery && !single) scopes.push(["pooled", "All queries pooled"]);
  if (!single) scopes.push(...section.scenes.map((scene, index) => [index, scene.title]));
  let table = null;

  function draw() {
    const title = scopes.find(([value]) => String(value) === String(state.scope))[1];
    table = methodsTable(section, state.scope, state.every, `${title}${markLegend(section, state.scope)}`);
    holder.replaceChildren(table.node);
    meanings.replaceChildren(glossary(section, state.every, meanings.querySelector("[open]") !== null));
    filter();
  }

  function filter() {
    const text = state.filter.toLowerCase();
    table.update(table.rows.filter((row) => row.name.toLowerCase().includes(text)));
  }

  const meanings = el("div", {});

  const scope = choice("Over", scopes, (value) => { state.scope = isNaN(value) ? value : Number(value); draw(); });
  const every = tick("All scores", false, (checked) => { state.every = checked; draw(); });
  const name = field("Methods that contain", "search", (text) => { state.filter = text; filter(); });
  draw();
  return panel(section, "summary", "Summary",
    el("div", { class: "controls" }, scope.node, name.node, every.node), holder,
    meanings, el("p", { class: "note" }, section.intervals.note),
    section.standings.note ? el("p", { class: "note" }, section.standings.note) : null,
    section.references.map((floor) => el("p", { class: "note" }, `${floor.name}: ${floor.meaning}`)),
    notesView(section));
}

function markLegend(section, ...scopes) {
  if (section.methods.length === 1) return "";
  const found = scopes.map((scope) => scopeOf(section.standings, scope));
  if (!found.some((scope) => scope.tested)) return "; ★ marks the best, which is not tested";
  const tied = found.some((scope) => scope.marks.flat().includes("tied"));
  return `; ★ marks the best${tied ? ", ≈ what cannot be told from it" : ""}`;
}

function notesView(section) {
  const every = section.methods.length;
  const list = el("ul", { class: "notes" }, section.notes.map((note) =>
    el("li", {}, `${note.methods.length === every && every > 1 ? "All methods" : note.methods.join(", ")}: ${note.text}`)));
  return folded(section.notes.length, 6, `Notes on methods (${section.notes.length})`, list);
}

function scoreChoice(section, scores, onchange) {
  return choice("Score", scores.map((score) => [score.key, score.heading]), onchange);
}

function scenesView(section) {
  const holder = el("div", {});
  const drill = el("div", {});
  let shownId = null;
  section.open.scene = show;
  section.close.scene = () => drill.replaceChildren();

  function draw(key) {
    const index = section.scores.findIndex((score) => score.key === key);
    const score = section.scores[index];
    const at = (part, scene, method) => section.standings.perScene[scene][part][method][index];
    const value = (scene, method) => number(at("values", scene, method));
    const rows = section.scenes.map((scene, place) => ({ scene, place }));
    const columns = [
      { title: "Scene", text: true, value: (row) => row.scene.title,
        show: (row) => el("button", { type: "button", class: "link", "data-scene": row.scene.id, onclick: () => open(row.scene.id) }, row.scene.title) },
      ...(section.byQuery ? [{ title: "Queries", value: (row) => row.scene.queries, show: (row) => String(row.scene.queries), bestFirst: "descending" }] : []),
      ...section.methods.map((method, number) => ({
        title: method.name, value: (row) => value(row.place, number), show: (row) => at("texts", row.place, number),
        tint: (row) => tinted(section.standings.tints[row.place][number][index]), bestFirst: score.higher ? "descending" : "ascending",
        mark: (row) => at("marks", row.place, number),
      })),
    ];
    holder.replaceChildren(sortableTable(`${score.heading} by scene and method; darker is better${markLegend(section, ...section.scenes.keys())}; a scene's name opens it`, columns, rows).node);
  }

  function open(id) {
    visit(addressOf(section, "scene", id));
    show(id);
  }

  function show(id) {
    const place = section.scenes.findIndex((scene) => scene.id === id);
    if (place < 0) { drill.replaceChildren(unknown(section, "scenes", `This part has no scene ${id}.`)); return; }
    const scene = section.scenes[place];
    const actions = el("div", { class: "controls no-print" },
      section.queries ? el("button", { type: "button", onclick: () => section.listScene(place) }, "List its queries") : null,
      section.maps.some((map) => map.scene === scene.id) ? el("button", { type: "button", onclick: () => section.showScene(place) }, "Show it on the map") : null,
      el("button", { type: "button", onclick: leave }, "Close"));
    const { box, head } = drillBox(`${section.id}-scene`, section.byQuery ? `${scene.title}: ${scene.queries} queries` : scene.title, leave, actions,
      methodsTable(section, place, false, "Scores in this scene").node, countsTable(section, scene));
    if (section.breakdowns.length) box.append(el("h4", {}, "By condition"), conditionPicker(section, place + 1));
    drill.replaceChildren(box);
    shownId = id;
    reveal(box, head);
  }

  function leave() {
    visit(addressOf(section, "scenes"));
    drill.replaceChildren();
    const row = [...holder.querySelectorAll("tbody button")].find((button) => button.dataset.scene === shownId);
    if (row) reveal(row, row);
  }

  const scores = section.scores.filter((score) => score.headline);
  const score = scoreChoice(section, scores, draw);
  draw(scores[0].key);
  return panel(section, "scenes", "Scenes", el("div", { class: "controls" }, score.node), holder, drill);
}

// What an address asks for and is not here.
function unknown(section, view, text) {
  goTo(section, view);
  return el("p", { class: "drill", role: "alert" }, text);
}

function countsTable(section, scene) {
  const names = Object.keys(section.methods[0].counts[scene.id] || {});
  const columns = names.map((name) => ({
    title: name.replaceAll("_", " "), bestFirst: "descending",
    value: (row) => section.methods[row.index].counts[scene.id][name],
    show: (row) => String(section.methods[row.index].counts[scene.id][name] ?? "–"),
  }));
  return el("details", {}, el("summary", {}, "Counts"),
    sortableTable("What was counted", [methodColumn(), ...columns], methodRows(section)).node);
}

// A table and a chart of a score by a condition; scope 0 is all scenes, then scene by scene.
function conditionPicker(section, fixed) {
  const state = { condition: 0, score: 0, scope: fixed || 0 };
  const holder = el("div", {});

  async function draw() {
    const found = section.breakdowns[state.condition];
    const score = section.queryScores[state.score];
    const view = (await unpack(found.views))[state.scope][state.score];
    const counts = found.counts[state.scope];
    const groups = found.labels.map((label, index) => ({ label, index })).filter((row) => counts[row.index] > 0);
    const columns = [
      { title: found.title, text: true, value: (row) => row.index, show: (row) => row.label },
      { title: "Queries", value: (row) => counts[row.index], show: (row) => String(counts[row.index]), bestFirst: "descending" },
      ...section.methods.map((method, place) => ({
        title: method.name, value: (row) => number(view.values[place][row.index]), show: (row) => view.texts[place][row.index],
        tint: (row) => tinted(view.tints[place][row.index]), bestFirst: score.higher ? "descending" : "ascending",
        mark: (row) => view.marks[place][row.index],
      })),
    ];
    const where = state.scope ? section.scenes[state.scope - 1].title : "all scenes";
    const caption = `${score.heading} by ${found.title}, ${where}: over all queries of each group${markLegend(section)}`;
    holder.replaceChildren(conditionChart(section, score, found, groups, counts, view), sortableTable(caption, columns, groups).node);
  }

  const picks = [
    choice("Condition", section.breakdowns.map((found, index) => [index, found.title]), (value) => { state.condition = Number(value); draw(); }),
    choice("Score", section.queryScores.map((score, index) => [index, score.heading]), (value) => { state.score = Number(value); draw(); }),
  ];
  if (fixed === null && section.scenes.length > 1) {
    const scenes = [[0, "All scenes"], ...section.scenes.map((scene, index) => [index + 1, scene.title])];
    picks.push(choice("Scene", scenes, (value) => { state.scope = Number(value); draw(); }));
  }
  drawn.push(draw());
  return el("div", {}, el("div", { class: "controls" }, picks.map((pick) => pick.node)), holder);
}

function conditionsView(section) {
  return panel(section, "conditions", "Conditions", conditionPicker(section, null));
}

function figuresView(section) {
  return panel(section, "pictures", "Pictures", el("div", { class: "figures" }, section.figures.map((figure) =>
    el("figure", {}, el("img", { src: figure.src, alt: figure.title }), el("figcaption", {}, figure.title)))));
}

function settingsView(section) {
  const rows = section.settings.map(([key, value]) => ({ key, value }));
  const table = sortableTable("What can change a score", [
    { title: "Setting", text: true, value: (row) => row.key, show: (row) => row.key },
    { title: "Value", text: true, value: (row) => row.value, show: (row) => el("code", {}, row.value) },
  ], rows);
  const filter = field("Settings that contain", "search", (text) =>
    table.update(rows.filter((row) => `${row.key} ${row.value}`.toLowerCase().includes(text.toLowerCase()))));
  const facts = { Protocol: `${section.protocol.name} v${section.protocol.version}`, "Its fingerprint": section.protocol.fingerprint,
    Truth: `${section.truth.name} v${section.truth.version}`, "Its fingerprint ": section.truth.fingerprint };
  const methods = sortableTable("What was scored", [methodColumn(),
    ...[["File", "file"], ["Holds", "kind"], ["SHA-256", "sha256"], ["Made with", "versions"]].map(([title, key]) => ({
      title, text: true, wide: key === "sha256" || key === "versions", value: (row) => section.methods[row.index][key], show: (row) => el("code", {}, section.methods[row.index][key]) })),
  ], methodRows(section));
  return panel(section, "settings", "Settings and fingerprints", keyList(facts), methods.node,
    el("details", {}, el("summary", {}, `Settings of the protocol (${rows.length})`), el("div", { class: "controls" }, filter.node), table.node));
}

function keyList(facts) {
  return el("dl", { class: "keys" }, Object.entries(facts).flatMap(([key, value]) => [el("dt", {}, key.trim()), el("dd", {}, el("code", {}, String(value)))]));
}
