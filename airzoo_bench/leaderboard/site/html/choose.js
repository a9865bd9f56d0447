// Methods chosen by the boxes in their rows: two are compared, more are shown alone.
const cut = (name) => (name.length > 48 ? `${name.slice(0, 47)}…` : name);

function chooser(tray) {
  const table = document.getElementById(tray.dataset.table);
  const form = document.querySelector(`form.filters[data-table="${tray.dataset.table}"]`);
  const [said, link, only, clear] = ["p", "a", ".only", ".clear"].map((what) => tray.querySelector(what));
  const chosen = () => [...table.querySelectorAll(".pick input:checked")].map((box) => box.closest("tr"));

  function show() {
    const rows = chosen();
    tray.hidden = rows.length === 0;
    said.textContent = `${rows.length} chosen: ${rows.map((row) => cut(row.dataset.name)).join("; ")}`;
    link.hidden = rows.length !== 2;
    if (rows.length !== 2) return;
    const [a, b] = rows.map((row) => row.dataset.id);
    link.setAttribute("href", `${tray.dataset.page}#${new URLSearchParams({ a, b })}`);
  }

  table.addEventListener("change", show);
  only.hidden = !form;
  only.addEventListener("click", () => {
    form.only = new Set(chosen().map((row) => row.dataset.id));
    form.apply("only the chosen ones");
  });
  clear.addEventListener("click", () => {
    for (const row of chosen()) row.querySelector(".pick input").checked = false;
    if (form) form.only = null;
    form?.apply("nothing chosen");
    show();
    table.querySelector("tbody tr:not([hidden]) .pick input")?.focus();
  });
  show();
}

for (const tray of document.querySelectorAll(".tray")) chooser(tray);
