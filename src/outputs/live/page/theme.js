// Dark or light: as the system says until the button is used; drawings take their colours from the style sheet.

const systemIsLight = matchMedia("(prefers-color-scheme: light)");
const wantsLittleMotion = matchMedia("(prefers-reduced-motion: reduce)");

const isLight = () => (document.documentElement.dataset.theme || (systemIsLight.matches ? "light" : "dark")) === "light";

function changeTheme() {
  document.documentElement.dataset.theme = isLight() ? "dark" : "light";
  readColours();
  drawOverlay();
  drawAll();
}

systemIsLight.addEventListener("change", readColours);
