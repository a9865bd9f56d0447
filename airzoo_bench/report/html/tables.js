// Tables that Python wrote: their columns sort, and choices show one of several.
function sortable(table) {
  const body = table.tBodies[0];
  if (body.querySelectorAll("tr:not(.floor)").length < 2) return;
  [...table.tHead.rows[0].cells].forEach((head, place) => {
    const sort = button([...head.childNodes], () => {
      const now = head.getAttribute("aria-sort");
      const first = head.dataset.best || "ascending";
      const other = first === "ascending" ? "descending" : "ascending";
      const order = now === first ? other : first;
      for (const one of table.tHead.rows[0].cells) one.setAttribute("aria-sort", "none");
      head.setAttribute("aria-sort", order);
      const rows = [...body.rows].map((row) => [row, sortValue(row.cells[place])]);
      rows.sort(
        ([one, first], [other, second]) =>
          one.classList.contains("floor") - other.classList.contains("floor") ||
          compare(first, second, order === "descending"),
      );
      body.append(...rows.map(([row]) => row));
    });
    head.setAttribute("aria-sort", "none");
    head.replaceChildren(sort);
  });
}

function sortValue(cell) {
  if (cell.dataset.v === undefined)
    return cell.classList.contains("text") ? cell.textContent : null;
  const value = { inf: Infinity, "-inf": -Infinity }[cell.dataset.v] ?? Number(cell.dataset.v);
  return Number.isNaN(value) ? null : value;
}

// Shows the pane that the choices name.
function choosable(holder) {
  const selects = [...holder.querySelectorAll("select")];
  const show = () => {
    const keys = selects.map((select) => select.value);
    if ("sorted" in holder.dataset) keys.sort((one, other) => one - other);
    for (const pane of holder.querySelectorAll(".pane")) {
      const { key, starts } = pane.dataset;
      pane.hidden = starts === undefined ? key !== keys.join(" ") : starts !== keys[0];
    }
  };
  selects.forEach((select) => select.addEventListener("change", show));
  if (selects.length) show();
  holder.querySelector(".every")?.addEventListener("change", (event) => {
    holder.classList.toggle("few", !event.target.checked);
  });
  holder.querySelector(".filter")?.addEventListener("input", (event) => {
    const text = event.target.value.toLowerCase();
    for (const row of holder.querySelectorAll("tbody tr")) {
      row.hidden = !row.cells[0].textContent.toLowerCase().includes(text);
    }
  });
}
