// The queries of a part: found by what they are, listed, and one of them told in full.
const ROWS = 50;

async function loadQueries(packed) {
  const load = async (column) => {
    const texts = await unpack(column.texts);
    return { ...column, texts, codes: await unpack(column.codes), hit: texts.indexOf("✓ hit") };
  };
  return {
    ids: await unpack(packed.ids),
    scene: await unpack(packed.scene),
    conditions: await Promise.all(packed.conditions.map(load)),
    scores: await Promise.all(packed.scores.map(load)),
    failures: await load(packed.failures),
  };
}

async function queriesView(part, box) {
  const table = await loadQueries(part.queries);
  const count = part.queries.count;
  const one = part.methods.length === 1;
  const state = { text: "", scene: -1, outcome: "all", method: 0, show: "s0", sort: null, at: 0 };
  state.chosen = -1;
  const hits = Math.max(
    0,
    table.scores.findIndex((score) => score.judges),
  );
  const judged = table.scores[hits].judges;
  const [listed, counted] = [box.querySelector(".listed"), box.querySelector(".counted")];
  const pager = box.querySelector(".pager");
  let rows = [];

  const codeOf = (score, method, row) => score.codes[method * count + row];
  const failureOf = (method, row) => table.failures.texts[codeOf(table.failures, method, row)];
  // What a score is; beside the first one, or one that stands alone, why there is no better.
  const textOf = (score, method, row, alone = score === table.scores[0]) => {
    const why = alone ? failureOf(method, row) : "";
    return score.texts[codeOf(score, method, row)] + (why ? `, ${why}` : "");
  };
  const isHit = (row, method = state.method) =>
    !judged || codeOf(table.scores[hits], method, row) === table.scores[hits].hit;
  const context = { part, table, state, isHit, choose, rows: () => rows };
  const map = part.maps.length ? mapView(context, box) : null;

  function passes(row) {
    if (state.scene >= 0 && table.scene[row] !== state.scene) return false;
    if (state.text && !wordsOf(row).includes(state.text)) return false;
    if (state.outcome === "hits") return isHit(row);
    if (state.outcome === "misses") return !isHit(row);
    if (state.outcome === "all") return true;
    const found = part.methods.filter((_, method) => isHit(row, method)).length;
    return state.outcome === "none" ? !found : found > 0 && found < part.methods.length;
  }

  function wordsOf(row) {
    const words = table.conditions.filter((column) => !column.numeric);
    const texts = words.map((column) => column.texts[column.codes[row]]);
    return [table.ids[row], failureOf(state.method, row), ...texts]
      .join(" ")
      .toLowerCase();
  }

  function refresh() {
    rows = [...Array(count).keys()].filter(passes);
    if (state.sort) {
      const { value, descending } = state.sort;
      rows.sort((one, other) => compare(value(one), value(other), descending) || one - other);
    }
    const found = rows.filter((row) => isHit(row)).length;
    const judgement = `; ${part.methods[state.method]}: ${found} hits and ${rows.length - found} misses by ${table.scores[hits].title}`;
    counted.textContent = `${rows.length.toLocaleString("en")} of ${count.toLocaleString("en")} queries${judged ? judgement : ""}`;
    state.at = 0;
    list();
    map?.draw();
  }

  function columns() {
    const place = Number(state.show.slice(1));
    const value = (packed, at) => (row) =>
      packed.texts[packed.codes[at + row]] === "–" ? null : packed.codes[at + row];
    const alone = state.show[0] === "s"; // one score, of all methods
    const pairs = alone
      ? part.methods.map((name, method) => [name, table.scores[place], method])
      : table.scores.map((score) => [score.title, score, place]);
    return [
      { title: "Query", value: (row) => row, best: "ascending" },
      ...pairs.map(([title, score, method]) => ({
        title,
        value: value(score, method * count),
        show: (row) => textOf(score, method, row, alone || score === table.scores[0]),
        best: score.best,
      })),
      ...table.conditions.map((column) => ({
        title: column.title,
        value: value(column, 0),
        show: (row) => column.texts[column.codes[row]],
        text: !column.numeric,
      })),
    ];
  }

  function list() {
    const heads = columns().map((column) => {
      const sorted = state.sort && state.sort.title === column.title;
      const order = sorted ? (state.sort.descending ? "descending" : "ascending") : "none";
      const sort = button(column.title, () => {
        const descending = sorted ? !state.sort.descending : column.best === "descending";
        state.sort = { ...column, descending };
        refresh();
      });
      const kind = column.text || !column.show ? "text" : "";
      return el("th", { scope: "col", class: kind, "aria-sort": order }, sort);
    });
    const body = rows.slice(state.at, state.at + ROWS).map((row) =>
      el(
        "tr",
        { class: row === state.chosen ? "picked" : "" },
        columns().map((column) =>
          column.show
            ? el("td", { class: column.text ? "text" : "" }, column.show(row))
            : el("th", { scope: "row" }, el("a", { href: addressOf(row) }, table.ids[row])),
        ),
      ),
    );
    const caption = el("caption", { class: "sr" }, "Queries");
    const head = el("thead", {}, el("tr", {}, heads));
    listed.replaceChildren(el("table", {}, caption, head, el("tbody", {}, body)));
    const last = Math.min(rows.length, state.at + ROWS);
    const turn = (by) => () => {
      state.at += by;
      list();
    };
    pager.replaceChildren(
      ...(state.at > 0 ? [button("Previous", turn(-ROWS))] : []),
      ...(last < rows.length ? [button("Next", turn(ROWS))] : []),
      el("span", { class: "note" }, rows.length > ROWS ? `${state.at + 1} to ${last}` : ""),
    );
  }

  function addressOf(row) {
    return `#${part.id}-query=${encodeURIComponent(table.ids[row])}`;
  }

  // Tells all of a query; a row of -1 lets go of it.
  function choose(row, remember = true, closer = true) {
    state.chosen = row;
    if (remember) history.replaceState(null, "", row < 0 ? `#${part.id}-queries` : addressOf(row));
    const chosen = box.querySelector(".chosen");
    const pictures = row < 0 ? null : picturesOf(row);
    const wide = pictures?.querySelector(".wide");
    box.querySelector(".lines").replaceChildren(...(wide ? [pictures] : []));
    chosen.replaceChildren(...(row < 0 ? [] : describe(row, wide ? null : pictures)));
    chosen.querySelectorAll(".scroll").forEach(fading);
    list();
    map?.focus(row, closer);
  }

  // The pictures of a query that is among the hardest, from its card.
  function picturesOf(row) {
    const links = [...document.querySelectorAll(`#${part.id}-hardest .card a`)];
    const card = links.find((link) => link.textContent === table.ids[row])?.closest(".card");
    if (card?.querySelector("img")) return card.querySelector(".pictures").cloneNode(true);
    const how = el("code", {}, "airzoo-bench report --pictures N");
    return el("p", { class: "note" }, "Pictures are kept of the hardest queries: ", how);
  }

  function describe(row, pictures) {
    const facts = [["Scene", part.scenes[table.scene[row]]]];
    table.conditions.forEach((one) => facts.push([one.title, one.texts[one.codes[row]]]));
    const heads = ["Method", ...table.scores.map((score) => score.title)];
    const lines = part.methods.map((name, method) =>
      el(
        "tr",
        {},
        el("th", { scope: "row" }, name),
        table.scores.map((score) => el("td", {}, textOf(score, method, row))),
      ),
    );
    const head = el(
      "tr",
      {},
      heads.map((text, place) => el("th", { scope: "col", class: place ? "" : "text" }, text)),
    );
    return [
      el("h4", {}, table.ids[row]),
      pictures,
      el(
        "div",
        { class: "scroll", tabindex: "0", role: "group", "aria-label": "Scores of the query" },
        el("table", {}, el("thead", {}, head), el("tbody", {}, lines)),
      ),
      map ? map.tilesOf(row) : null,
      el(
        "dl",
        { class: "keys" },
        facts.flatMap(([key, text]) => [el("dt", {}, key), el("dd", {}, text)]),
      ),
    ].filter((node) => node);
  }

  const outcomes = [["all", "All queries"]];
  if (judged) outcomes.push(["hits", "Hits of the method"], ["misses", "Misses of the method"]);
  if (judged && !one) outcomes.push(["none", "No method hits"], ["some", "Methods disagree"]);
  const set = (key, number) => (value) => {
    state[key] = number ? Number(value) : value;
    refresh();
    if (key === "method" && state.chosen >= 0) choose(state.chosen, false);
  };
  const search = el("input", { type: "search", autocomplete: "off" });
  search.addEventListener("input", () => set("text")(search.value.toLowerCase()));
  const shows = [
    ...table.scores.map((score, place) => [`s${place}`, `${score.title} of all methods`]),
    ...part.methods.map((name, method) => [`m${method}`, `All scores of ${name}`]),
  ];
  const finders = [
    choice("Method", [...part.methods.entries()], set("method", true)),
    choice("Outcome", outcomes, set("outcome")),
    choice("Scene", [[-1, "All"], ...part.scenes.entries()], set("scene", true)),
    choice("Columns", one ? shows.filter(([key]) => key[0] === "m") : shows, set("show")),
  ];
  if (one) state.show = "m0";
  box
    .querySelector(".finder")
    .append(el("label", {}, "Queries that contain ", search), ...finders.map((made) => made.node));
  refresh();
  await map?.load();
  if (matchMedia("(min-width: 60rem)").matches && !location.hash.includes("-query=")) {
    const hardest = document.querySelector(`#${part.id}-hardest .card a`);
    choose(Math.max(0, table.ids.indexOf(hardest?.textContent)), false, false);
  }
  return (id) => {
    const row = table.ids.indexOf(id);
    if (row < 0) box.querySelector(".chosen").replaceChildren(`This part has no query ${id}.`);
    else choose(row, false);
    box.querySelector(".chosen").focus({ preventScroll: true });
    (box.querySelector(".map") || box.querySelector(".chosen")).scrollIntoView({
      block: "nearest",
    });
  };
}
