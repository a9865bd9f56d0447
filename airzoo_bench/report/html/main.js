// The page: tables sort at once, maps and clouds are made when their fold is opened.
const open = {};

function makeFold(part, name, make) {
  const box = document.getElementById(`${part.id}-${name}`);
  if (!box) return;
  let made = null;
  open[box.id] = () => {
    box.open = true;
    made = made || make(part, box);
    return made;
  };
  box.addEventListener("toggle", () => box.open && open[box.id]());
}

// The address says what is open: #part2-pairs, #part2-query=ID.
async function route() {
  const found = /^#(part\d+)-query=(.*)$/.exec(location.hash);
  if (found) {
    try {
      const show = await open[`${found[1]}-queries`]?.();
      show?.(decodeURIComponent(found[2]));
    } catch (error) {
      if (!(error instanceof URIError)) throw error; // an address that was cut off within a letter
    }
    return;
  }
  const box = location.hash.length > 1 ? document.getElementById(location.hash.slice(1)) : null;
  if (box?.matches("details")) box.open = true;
  box?.scrollIntoView();
}

document.querySelectorAll("main table").forEach(sortable);
document.querySelectorAll(".panes").forEach(choosable);
document.querySelectorAll(".scroll").forEach(fading);
for (const part of page.parts) {
  makeFold(part, "queries", queriesView);
  makeFold(part, "clouds", cloudsView);
}
const wide = matchMedia("(min-width: 60rem)").matches;
document.querySelectorAll("details[data-wide]").forEach((box) => {
  if (wide) box.open = true;
});
// A phone shows the first cloud and the first map, as far as the page stays short.
async function unfoldFirst() {
  for (const kind of ["clouds", "queries"]) {
    const box = document.querySelector(`details[id$=${kind}][data-wide]`);
    await open[box?.id]?.();
    if (box && document.documentElement.scrollHeight > 4000) box.open = false;
  }
}
if (!wide && !location.hash) unfoldFirst();
window.addEventListener("hashchange", route);
if (location.hash) route();
// What is folded away is printed too, and folded again.
let unfolded = [];
window.addEventListener("beforeprint", () => {
  unfolded = [...document.querySelectorAll("details:not([open])")];
  unfolded.forEach((part) => (part.open = true));
});
window.addEventListener("afterprint", () => unfolded.forEach((part) => (part.open = false)));
