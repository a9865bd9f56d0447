// Filters of a table: what its form asks is compared with what its rows say of themselves. The
// address keeps it, so that a view can be passed on.
const plain = (text) => text.normalize("NFKD").replace(/\p{M}/gu, "").toLowerCase();

const ASKED = {
  name: (row, value) => (row.dataset.plain ??= plain(row.dataset.name)).includes(plain(value)),
  source: (row, value) => row.dataset.source === value,
  pipeline: (row, value) => row.dataset.pipeline === value,
  code: (row) => row.dataset.code === "yes",
  since: (row, value) => (row.dataset.date ?? "") >= value,
  // Who does not say what the method was trained on is neither with nor without it.
  training: (row, value) => row.dataset.training !== undefined
    && row.dataset.training.split(" ").includes(value.slice(1)) === (value[0] === "+"),
};

function filtered(form) {
  const tables = form.dataset.table.split(" ").map((id) => document.getElementById(id));
  const fields = [...form.elements].filter((field) => field.name in ASKED);
  const valueOf = (field) => (field.type === "checkbox" ? (field.checked ? "yes" : "") : field.value.trim());

  function apply(done) {
    const asked = fields.filter(valueOf);
    for (const row of tables.flatMap((table) => [...table.tBodies[0].rows])) {
      row.hidden = !asked.every((field) => ASKED[field.name](row, valueOf(field)))
        || Boolean(form.only && !form.only.has(row.dataset.id));
    }
    tell(tables[0], done);
  }

  function keep() {
    const said = new URLSearchParams(fields.filter(valueOf).map((field) => [field.name, valueOf(field)]));
    history.replaceState(null, "", said.size ? `#${said}` : location.pathname + location.search);
  }

  function restore() {
    const said = new URLSearchParams(location.hash.slice(1));
    for (const field of fields) {
      if (field.type === "checkbox") field.checked = said.has(field.name);
      else field.value = said.get(field.name) ?? "";
      if (field.type === "select-one" && field.selectedIndex < 0) field.selectedIndex = 0;
    }
  }

  form.apply = apply;
  form.addEventListener("submit", (event) => event.preventDefault());
  // Some browsers say of a choice only that it has changed.
  for (const kind of ["input", "change"]) form.addEventListener(kind, () => { apply(); keep(); });
  form.addEventListener("reset", () => setTimeout(() => { form.only = null; apply("filters cleared"); keep(); }));
  restore();
  apply();
}

// Folded where the page is narrow, unless they hide rows; where it is wide, the fold is not seen.
const narrow = matchMedia("(max-width: 40rem)");
for (const form of document.querySelectorAll("form.filters")) {
  filtered(form);
  const fold = form.closest("details");
  fold.open = !narrow.matches || location.hash.includes("=");
  narrow.addEventListener("change", () => { fold.open = fold.open || !narrow.matches; });
}
