const TRACKS = { retrieval: "Aerial image retrieval", matching: "Cross-view matching", reconstruction: "Multi-view reconstruction" };

function trackView(section) {
  section.queryScores = section.scores.filter((score) => score.ofQueries);
  section.open = {}; // by view: shows what has an id
  section.close = {};
  const views = [["summary", "Summary", summaryView(section)]];
  if (section.scenes.length > 1 || section.breakdowns.length) views.push(["scenes", "Scenes", scenesView(section)]);
  if (section.breakdowns.length) views.push(["conditions", "Conditions", conditionsView(section)]);
  if (section.figures.length) views.push(["pictures", "Pictures", figuresView(section)]);
  if (section.maps.length) views.push(["map", "Map", mapView(section)]);
  if (section.queries) views.push(["queries", "Queries", queriesView(section)]);
  if (section.hardest.length) views.push(["hardest", "Hardest queries", hardestView(section)]);
  views.push(["settings", "Settings", settingsView(section)]);
  const title = `${TRACKS[section.track] || section.track}: ${section.protocol.name} v${section.protocol.version}`;
  const total = section.scenes.reduce((sum, scene) => sum + scene.queries, 0);
  const facts = [`${section.methods.length} method${section.methods.length > 1 ? "s" : ""}`, `${section.scenes.length} scene${section.scenes.length > 1 ? "s" : ""}`,
    ...(section.byQuery ? [`${total.toLocaleString("en")} ${total === 1 ? "query" : "queries"}`] : []), `protocol ${section.protocol.fingerprint.slice(0, 12)}`, `truth ${section.truth.fingerprint.slice(0, 12)}`];
  return el("section", { class: "track", id: section.id, "aria-labelledby": `${section.id}-h` },
    el("h2", { id: `${section.id}-h` }, title), el("p", { class: "soft" }, facts.join(" · ")),
    el("nav", { "aria-label": title }, el("ul", {}, views.map(([name, text]) => el("li", {}, el("a", { href: `#${section.id}-${name}`, onclick: follow }, text))))),
    views.map(([, , view]) => view));
}

const content = document.getElementById("content");
content.append(...page.sections.map(trackView));
if (page.sections.length > 1) {
  document.getElementById("page-nav").append(el("ul", {}, page.sections.map((section) =>
    el("li", {}, el("a", { href: `#${section.id}`, onclick: follow }, `${TRACKS[section.track] || section.track}, ${section.protocol.name}`)))));
}
// What is folded away is printed too, and folded again.
let unfolded = [];
window.addEventListener("beforeprint", () => {
  unfolded = [...document.querySelectorAll("details:not([open], .no-print)")];
  unfolded.forEach((part) => { part.open = true; });
});
window.addEventListener("afterprint", () => unfolded.forEach((part) => { part.open = false; }));
window.addEventListener("popstate", route);
// Pictures and tables take their room first, so that what was asked for stays in sight.
const pictures = [...document.querySelectorAll(".figures img")].map((picture) => picture.decode().catch(() => null));
Promise.all([...pictures, ...drawn]).then(() => { if (location.hash) route(); });
