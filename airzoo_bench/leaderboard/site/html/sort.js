// Tables whose columns sort. What stands in the page is in rank order; a header says by
// data-kind what its column holds, a cell by data-v what it is sorted by ("" is missing).
const COLLATOR = new Intl.Collator("en", { numeric: true });

function keyOf(row, column, kind) {
  const cell = row.cells[column];
  const said = cell.dataset.v ?? cell.textContent.trim();
  if (said === "") return { last: 2, value: 0 };
  if (kind !== "number") return { last: 0, value: said };
  const value = Number(said.replace("inf", "Infinity"));
  return { last: Number.isFinite(value) ? 0 : Number.isNaN(value) ? 2 : 1, value };
}

// What is infinite and then what is missing stands last either way; equals stay as they stood.
function inOrder(rows, column, kind, descending) {
  const keyed = rows.map((row) => ({ row, ...keyOf(row, column, kind) }));
  const sign = descending ? -1 : 1;
  keyed.sort((one, other) => one.last - other.last || (one.last ? 0 : sign * compared(one.value, other.value)));
  return keyed.map((found) => found.row);
}

function compared(one, other) {
  return typeof one === "string" ? COLLATOR.compare(one, other) : one - other;
}

function sortable(table) {
  const heads = [...table.tHead.rows[0].cells];
  const body = table.tBodies[0];
  heads.forEach((head, column) => {
    const kind = head.dataset.kind;
    if (!kind) return;
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.replaceChildren(button);
    button.addEventListener("click", () => {
      const was = head.getAttribute("aria-sort");
      const way = was ? (was === "ascending" ? "descending" : "ascending") : head.dataset.first ?? "ascending";
      for (const other of heads) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", way);
      body.append(...inOrder([...body.rows], column, kind, way === "descending"));
      tell(table, `sorted by ${head.dataset.name}, ${way}`);
    });
  });
}

// Says in the table's live region how many rows are shown, and what was done.
function tell(table, done) {
  const region = document.getElementById(table.dataset.status ?? "");
  if (!region) return;
  const rows = [...table.tBodies[0].rows];
  const shown = rows.filter((row) => !row.hidden).length;
  region.textContent = `${shown} of ${rows.length} ${rows.length === 1 ? "method" : "methods"} shown${done ? `; ${done}` : ""}.`;
}

for (const table of document.querySelectorAll("table.sortable")) sortable(table);
