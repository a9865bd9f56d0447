const TRACKS = { retrieval: "Aerial image retrieval", matching: "Cross-view matching", reconstruction: "Multi-view reconstruction" };

function trackView(section) {
  section.queryScores = section.scores.filter((score) => score.ofQueries);
  const open = {};
  const views = [["summary", "Summary", summaryView(section)]];
  if (section.scenes.length > 1 || section.breakdowns.length) views.push(["scenes", "Scenes", scenesView(section, open)]);
  if (section.breakdowns.length) views.push(["conditions", "Conditions", conditionsView(section)]);
  if (section.figures.length) views.push(["pictures", "Pictures", figuresView(section)]);
  if (section.maps.length) views.push(["map", "Map", mapView(section, open)]);
  if (section.queries) views.push(["queries", "Queries", queriesView(section, open)]);
  if (section.hardest.length) views.push(["hardest", "Hardest queries", hardestView(section, open)]);
  views.push(["settings", "Settings", settingsView(section)]);
  const title = `${TRACKS[section.track] || section.track}: ${section.protocol.name} v${section.protocol.version}`;
  const total = section.scenes.reduce((sum, scene) => sum + scene.queries, 0);
  const facts = [`${section.methods.length} method${section.methods.length > 1 ? "s" : ""}`, `${section.scenes.length} scene${section.scenes.length > 1 ? "s" : ""}`,
    ...(section.byQuery ? [`${total.toLocaleString("en")} queries`] : []), `protocol ${section.protocol.fingerprint.slice(0, 12)}`, `truth ${section.truth.fingerprint.slice(0, 12)}`];
  return el("section", { class: "track", id: section.id, "aria-labelledby": `${section.id}-h` },
    el("h2", { id: `${section.id}-h` }, title), el("p", { class: "soft" }, facts.join(" · ")),
    el("nav", { "aria-label": title }, el("ul", {}, views.map(([name, text]) => el("li", {}, el("a", { href: `#${section.id}-${name}` }, text))))),
    views.map(([, , view]) => view));
}

const content = document.getElementById("content");
content.append(...page.sections.map(trackView));
if (page.sections.length > 1) {
  document.getElementById("page-nav").append(el("ul", {}, page.sections.map((section) =>
    el("li", {}, el("a", { href: `#${section.id}` }, `${TRACKS[section.track] || section.track}, ${section.protocol.name}`)))));
}
// What is folded away is printed too.
window.addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((part) => { part.open = true; }));
