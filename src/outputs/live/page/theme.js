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

// Paper is white: drawings change to light colours while the page is printed.
let themeOnScreen;
addEventListener("beforeprint", () => {
  themeOnScreen = document.documentElement.dataset.theme;
  if (!isLight()) changeTheme();
});
addEventListener("afterprint", () => {
  if ((themeOnScreen || (systemIsLight.matches ? "light" : "dark")) === "dark") changeTheme();
  if (themeOnScreen === undefined) delete document.documentElement.dataset.theme;
});
