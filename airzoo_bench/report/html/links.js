// The address says what is open: #part2-map, #part2-query=ID, #part2-map=ID&by=METHOD, #part2-scene=ID.
function addressOf(section, view, id, by) {
  const what = id === undefined ? "" : `=${encodeURIComponent(id)}`;
  return `#${section.id}-${view}${what}${by === undefined ? "" : `&by=${encodeURIComponent(by)}`}`;
}

// Writes the address down, as a step that the back button undoes, or in place of the last one.
function visit(address, replaces = false) {
  if (location.hash === address) return;
  if (replaces) history.replaceState(null, "", address);
  else history.pushState(null, "", address);
}

function parsedAddress() {
  const found = /^#(part\d+)(?:-([a-z]+))?(?:=([^&]*))?(?:&by=(.*))?$/.exec(location.hash);
  if (!found) return null;
  try {
    const [id, by] = [found[3], found[4]].map((text) => (text === undefined ? undefined : decodeURIComponent(text)));
    return { section: page.sections.find((section) => section.id === found[1]), view: found[2], id, by };
  } catch {
    return null; // cut off within a letter
  }
}

// Shows what the address says, and closes what it does not name.
async function route() {
  const asked = parsedAddress();
  for (const section of page.sections) for (const close of Object.values(section.close)) close();
  if (!asked || !asked.section) return;
  const { section, view, id, by } = asked;
  if (id !== undefined && section.open[view]) await section.open[view](id, by);
  else if (view) goTo(section, view);
  else document.getElementById(section.id).scrollIntoView();
}

function linkTo(section, view, id, text, by) {
  return el("a", { href: addressOf(section, view, id, by), onclick: follow }, text);
}

// A click leaves open what is open; only going back and forth closes it.
function follow(event) {
  if (event.ctrlKey || event.metaKey || event.shiftKey || event.button) return;
  event.preventDefault();
  const address = event.currentTarget.getAttribute("href");
  history.pushState(null, "", address);
  const { section, view, id, by } = parsedAddress();
  if (id !== undefined && section.open[view]) section.open[view](id, by);
  else if (view) goTo(section, view);
  else document.getElementById(section.id).scrollIntoView();
}
