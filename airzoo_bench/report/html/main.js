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
// A phone shows the first map, if the page stays short.
const first = wide || location.hash ? null : document.querySelector("details[id$=queries][data-wide]");
if (first) {
  open[first.id]().then(() => {
    if (document.documentElement.scrollHeight > 4000) first.open = false;
  });
}
window.addEventListener("hashchange", route);
if (location.hash) route();
// What is folded away is printed too, and folded again.
let unfolded = [];
window.addEventListener("beforeprint", () => {
  unfolded = [...document.querySelectorAll("details:not([open])")];
  unfolded.forEach((part) => (part.open = true));
});
window.addEventListener("afterprint", () => unfolded.forEach((part) => (part.open = false)));
