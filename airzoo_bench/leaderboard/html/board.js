// The table of results: it sorts, filters, shows scenes and conditions, and lets two methods be chosen.
const table = document.getElementById("results");
const form = document.getElementById("filters");
const tray = document.querySelector(".tray");
const board = JSON.parse(document.getElementById("data").textContent);
const FEW = 20;

if (table) {
  const rows = [...table.querySelectorAll("tbody tr")];
  const said = document.getElementById("said");
  const caption = document.querySelector("#caption span");
  const averages = new Map([...table.querySelectorAll("[data-at].num")].map((cell) => [cell, [cell.cloneNode(true), cell.className]]));
  const usual = caption.textContent;
  const collator = new Intl.Collator("en", { numeric: true });
  const plain = (text) => text.normalize("NFKD").replace(/\p{M}/gu, "").toLowerCase();
  const valueOf = (field) => (field.type === "checkbox" ? (field.checked ? "yes" : "") : field.value.trim());
  const fields = [...form.elements].filter((field) => field.name);

  // --- filters ---

  const passes = {
    name: (row, value) => plain(row.dataset.name).includes(plain(value)),
    kind: (row, value) => row.dataset.kind === value,
    pipeline: (row, value) => row.dataset.pipeline === value,
    code: (row) => row.dataset.code === "yes",
    // Who does not say what a method was trained on is neither with nor without it.
    training: (row, value) => row.dataset.training !== undefined
      && row.dataset.training.split(" ").includes(value.slice(1)) === (value[0] === "+"),
  };

  function filter(done = "") {
    const asked = fields.filter((field) => field.name in passes && valueOf(field));
    for (const row of rows) row.hidden = !asked.every((field) => passes[field.name](row, valueOf(field)));
    const methods = rows.filter((row) => row.dataset.kind !== "floor");
    const left = methods.filter((row) => !row.hidden).length;
    said.textContent = `${left} of ${methods.length} ${methods.length === 1 ? "method" : "methods"} shown${done ? `; ${done}` : ""}.`;
  }

  // --- scenes and conditions ---

  const written = (value, share) => (Number.isFinite(Number(value)) ? (share ? 100 * value : Number(value)).toFixed(2) : "inf");

  // The numbers of a row in a scene or a group of a condition, by the key of a score.
  function numbersOf(row, part, key) {
    const [, kind, group, name] = part.match(/^(\w+)\/(\d*)\/(.*)$/s);
    const found = row[kind][name]?.[key] ?? [];
    return group === "" ? found : [found[group]];
  }

  function fill(cell, [value, low, high], share) {
    cell.dataset.v = value ?? "";
    cell.className = cell.className.replace(/ ?tied/, "");
    cell.replaceChildren(value === undefined || value === null ? "–" : written(value, share));
    if (low === undefined || low === null || high === null) return;
    const span = document.createElement("span");
    span.className = "interval";
    span.textContent = `${written(low, share)} to ${written(high, share)}`;
    cell.append(span);
  }

  function showPart(field) {
    const option = field.selectedOptions[0];
    const isPart = field.value !== "";
    table.classList.toggle("of-part", isPart);
    table.classList.toggle("few", option.className === "few");
    caption.textContent = !isPart ? usual : `${option.parentNode.label}: ${option.textContent}${option.className === "few" ? ` (fewer than ${FEW} queries say little)` : ""}`;
    for (const [cell, [first, kind]] of averages) {
      if (isPart) {
        const score = board.scores[cell.dataset.at];
        fill(cell, numbersOf(board.rows[cell.closest("tr").dataset.at], field.value, score.key), score.unit === "share");
      } else {
        cell.className = kind;
        cell.dataset.v = first.dataset.v;
        cell.replaceChildren(...first.cloneNode(true).childNodes);
      }
    }
    const sorted = table.querySelector("th[aria-sort]");
    if (sorted) order(sorted, sorted.getAttribute("aria-sort"));
  }

  // --- sorting: what is infinite, and then what is missing, stands last either way ---

  function keyOf(row, at, kind) {
    const found = row.cells[at]?.dataset.v ?? row.cells[at]?.textContent.trim() ?? "";
    if (found === "" || row.dataset.kind === "failed") return { last: 2, value: 0 };
    if (kind !== "number") return { last: 0, value: found };
    const value = Number(found.replace(/^inf$/, "Infinity"));
    return { last: Number.isFinite(value) ? 0 : Number.isNaN(value) ? 2 : 1, value };
  }

  const compared = (one, other) => (typeof one === "string" ? collator.compare(one, other) : one - other);

  function order(head, way) {
    const at = [...head.parentNode.cells].indexOf(head);
    const sign = way === "descending" ? -1 : 1;
    const keyed = [...table.tBodies[0].rows].map((row) => ({ row, ...keyOf(row, at, head.dataset.sort) }));
    keyed.sort((one, other) => one.last - other.last || (one.last ? 0 : sign * compared(one.value, other.value)));
    table.tBodies[0].append(...keyed.map((found) => found.row));
    for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", way);
  }

  for (const head of table.querySelectorAll("th[data-sort]")) {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.replaceChildren(button);
    button.addEventListener("click", () => {
      const was = head.getAttribute("aria-sort");
      order(head, was ? (was === "ascending" ? "descending" : "ascending") : head.dataset.first);
      filter(`sorted by ${head.dataset.name}, ${head.getAttribute("aria-sort")}`);
    });
  }

  // --- the form, which the address keeps, so that a view can be passed on ---

  function apply() {
    for (const field of fields) {
      if (field.name === "part") showPart(field);
      if (field.name === "more") table.classList.toggle("all", field.checked);
    }
    filter();
  }

  function keep() {
    const asked = new URLSearchParams(fields.filter(valueOf).map((field) => [field.name, valueOf(field)]));
    history.replaceState(null, "", asked.size ? `#${asked}` : location.pathname + location.search);
  }

  const asked = new URLSearchParams(location.hash.slice(1));
  for (const field of fields) {
    if (field.type === "checkbox") field.checked = asked.has(field.name);
    else field.value = asked.get(field.name) ?? "";
    if (field.type === "select-one" && field.selectedIndex < 0) field.selectedIndex = 0;
  }
  form.addEventListener("submit", (event) => event.preventDefault());
  for (const kind of ["input", "change"]) form.addEventListener(kind, () => { apply(); keep(); });
  form.addEventListener("reset", () => setTimeout(() => { apply(); keep(); }));
  apply();

  // --- two methods ---

  if (tray) {
    const chosen = () => [...table.querySelectorAll(".pick input:checked")].map((box) => box.closest("tr"));
    const show = () => {
      const found = chosen();
      tray.hidden = found.length === 0;
      tray.querySelector("p").textContent = `${found.length} chosen: ${found.map((row) => row.dataset.name.slice(0, 48)).join("; ")}`;
      const link = tray.querySelector("a");
      link.hidden = found.length !== 2;
      if (found.length === 2) link.setAttribute("href", `compare.html#${new URLSearchParams({ a: found[0].dataset.id, b: found[1].dataset.id })}`);
    };
    table.addEventListener("change", show);
    tray.querySelector("button").addEventListener("click", () => {
      for (const row of chosen()) row.querySelector(".pick input").checked = false;
      show();
    });
    show();
  }
}
