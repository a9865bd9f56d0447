// Copies the BibTeX entry. Pages opened from disk may have no clipboard but that of a selection.
const entry = document.getElementById("bibtex");
document.getElementById("copy").addEventListener("click", async () => {
  let done = true;
  try {
    await navigator.clipboard.writeText(entry.textContent);
  } catch {
    getSelection().selectAllChildren(entry);
    done = document.execCommand("copy");
  }
  document.getElementById("copied").textContent = done ? "Copied." : "Selected: copy it with your keyboard.";
});
