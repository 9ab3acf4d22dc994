// The sphere to turn, and buttons that copy.
{
  const data = JSON.parse(document.getElementById("sphere-data").textContent);
  globalThis.gonioSphere = gonioViewer(document.getElementById("sphere"), data, { showLight: true });
  for (const button of document.querySelectorAll("button[data-copy]")) {
    const source = document.getElementById(button.dataset.copy);
    button.setAttribute("aria-live", "polite");
    button.onclick = async () => {
      try {
        await navigator.clipboard.writeText(source.textContent);
        button.textContent = "Copied";
      } catch {
        // Not every browser lets a local file write there: the text is ready for the usual keys.
        getSelection().selectAllChildren(source);
        button.textContent = "Selected";
      }
      setTimeout(() => (button.textContent = "Copy"), 2000);
    };
  }
}
