// Copies what a button names. Pages opened from disk may have no clipboard but that of a selection.
async function copied(node) {
  try {
    await navigator.clipboard.writeText(node.textContent);
    return true;
  } catch {
    getSelection().selectAllChildren(node);
    return document.execCommand("copy");
  }
}

for (const button of document.querySelectorAll("button[data-copy]")) {
  button.addEventListener("click", async () => {
    const done = await copied(document.getElementById(button.dataset.copy));
    document.getElementById(button.dataset.status).textContent = done ? "Copied." : "Selected: copy it with your keyboard.";
  });
}
