// The address says what is open: #part2-map, #part2-query=ID, #part2-map=ID&by=METHOD, #part2-scene=ID.
function addressOf(section, view, id, by) {
  const what = id === undefined ? "" : `=${encodeURIComponent(id)}`;
  return `#${section.id}-${view}${what}${by === undefined ? "" : `&by=${encodeURIComponent(by)}`}`;
}

// Back and forward lead to where the page was left: of each step, how far down that was. The
// browser's own memory would be undone by what opens and closes between the steps.
const tops = new Map();
let [step, lastTop] = [0, 0];

function rememberSteps() {
  history.scrollRestoration = "manual";
  step = history.state?.step ?? 0;
  history.replaceState({ step, top: history.state?.top ?? 0 }, "");
  window.addEventListener("scroll", () => { lastTop = window.scrollY; }, { passive: true });
  window.addEventListener("popstate", back);
  window.addEventListener("pagehide", keepTop);
}

function keepTop() {
  tops.set(step, window.scrollY);
  history.replaceState({ step, top: window.scrollY }, "");
}

// Writes the address down as a step that the back button undoes. Comes before the page moves.
function jump(address) {
  keepTop();
  step += 1;
  tops.delete(step);
  history.pushState({ step, top: 0 }, "", address);
}

// The same where it is another address than it was, perhaps in place of it.
function visit(address, replaces = false) {
  if (location.hash === address) return;
  if (replaces) history.replaceState(history.state, "", address);
  else jump(address);
}

async function back(event) {
  tops.set(step, lastTop); // an address that was typed may have moved the page already
  const known = event.state;
  step = known ? known.step : step + 1;
  if (!known) history.replaceState({ step, top: 0 }, "");
  const top = known ? tops.get(step) ?? known.top : null;
  await route();
  if (top !== null) window.scrollTo(0, top);
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
  jump(address);
  const asked = parsedAddress();
  if (!asked) { document.querySelector(address).scrollIntoView(); return; }
  const { section, view, id, by } = asked;
  if (id !== undefined && section.open[view]) section.open[view](id, by);
  else if (view) goTo(section, view);
  else document.getElementById(section.id).scrollIntoView();
}
