// How Chromium is started: without a window or a network of its own, and with WebGL in software, as machines without a graphics device have it.
export const FLAGS = [
  "--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run",
  "--disable-background-networking", "--disable-component-update", "--disable-sync",
];
