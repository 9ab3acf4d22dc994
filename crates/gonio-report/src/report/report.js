// The sphere to turn.
{
  const data = JSON.parse(document.getElementById("sphere-data").textContent);
  globalThis.gonioSphere = gonioViewer(document.getElementById("sphere"), data, { showLight: true });
}
