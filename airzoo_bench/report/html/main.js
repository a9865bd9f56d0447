function trackView(section) {
  section.queryScores = section.scores.filter((score) => score.ofQueries);
  section.open = {}; // by view: shows what has an id
  section.close = {};
  const views = [["summary", "Summary", summaryView(section)]];
  if (section.pairs) views.push(["pairs", "Two methods", pairsView(section)]);
  if (section.scenes.length > 1 || section.breakdowns.length) views.push(["scenes", "Scenes", scenesView(section)]);
  if (section.breakdowns.length) views.push(["conditions", "Conditions", conditionsView(section)]);
  if (section.figures.length) views.push(["pictures", "Pictures", figuresView(section)]);
  if (section.maps.length) views.push(["map", "Map", mapView(section)]);
  if (section.queries) views.push(["queries", "Queries", queriesView(section)]);
  if (section.hardest.length) views.push(["hardest", "Hardest queries", hardestView(section)]);
  views.push(["settings", "Settings", settingsView(section)]);
  const title = `${TRACKS[section.track] || section.track}: ${section.protocol.name} v${section.protocol.version}`;
  const [methods, scenes] = [section.methods.length, section.scenes.length];
  const facts = [`${methods} method${methods > 1 ? "s" : ""}`, `${scenes} scene${scenes > 1 ? "s" : ""}`,
    ...(section.byQuery ? [`${queryCount(section).toLocaleString("en")} ${queryCount(section) === 1 ? "query" : "queries"}`] : []), `protocol ${section.protocol.fingerprint.slice(0, 12)}`, `truth ${section.truth.fingerprint.slice(0, 12)}`];
  return el("section", { class: "track", id: section.id, "aria-labelledby": `${section.id}-h` },
    el("h2", { id: `${section.id}-h` }, title), el("p", { class: "soft" }, facts.join(" · ")),
    partLine(section, views),
    views.map(([, , view]) => view));
}

const content = document.getElementById("content");
if (page.sections.length > 1) content.append(overviewTable());
content.append(...page.sections.map(trackView));
// What is folded away is printed too, and folded again.
let unfolded = [];
window.addEventListener("beforeprint", () => {
  unfolded = [...document.querySelectorAll("details:not([open], .no-print)")];
  unfolded.forEach((part) => { part.open = true; });
});
window.addEventListener("afterprint", () => unfolded.forEach((part) => { part.open = false; }));
// Pictures and tables take their room first, so that what was asked for stays in sight.
const pictures = [...document.querySelectorAll(".figures img")].map((picture) => picture.decode().catch(() => null));
rememberSteps();
Promise.all([...pictures, ...drawn]).then(async () => {
  if (location.hash) await route();
  if (history.state.top) window.scrollTo(0, history.state.top); // opened again, as by the reload button
});
