// Keys, and the help about them.

const toggle = (name) => byId(name).click();

// Key, its name for people, meaning, action.
const KEYS = [
  ["p", "p", "hold the frame, or go on", togglePause],
  [",", ",", "one frame back", () => step(-1)],
  [".", ".", "one frame forward", () => step(1)],
  ["+", "+", "larger", () => zoomBy(ZOOM_STEP)],
  ["-", "-", "smaller", () => zoomBy(1 / ZOOM_STEP)],
  ["0", "0", "the whole frame", showWhole],
  ["t", "t", "truth on or off", () => toggle("overlay-on")],
  ["m", "m", "magnitudes on or off", () => toggle("labels-on")],
  ["n", "n", "names of stars on or off", () => toggle("names-on")],
  ["[", "[", "the head before", () => stepHead(-1)],
  ["]", "]", "the next head", () => stepHead(1)],
  ["1", "1", "page View", () => choosePage("view")],
  ["2", "2", "page Events", () => choosePage("events")],
  ["3", "3", "page Timing", () => choosePage("timing")],
  ["d", "d", "dark or light", changeTheme],
  ["?", "?", "this help", openHelp],
];
const ON_FRAME = [["arrows", "on the frame: choose a pixel; Escape gives it up"], ["shift + arrows", "on the frame: move"]];
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
// Part of the view by which shift and an arrow move it.
const MOVE = 0.15;

function stepHead(by) {
  const heads = lastState ? lastState.heads.length : 1;
  chooseHead((chosenHead + by + heads) % heads);
}

function openHelp() {
  if (!byId("help").open) byId("help").showModal();
}

function onFrameKey(event) {
  const arrow = ARROWS[event.key];
  if (event.key === "Escape") forgetPixel();
  if (!arrow || event.ctrlKey || event.altKey || event.metaKey) return;
  event.preventDefault();
  if (!event.shiftKey) {
    movePixel(...arrow);
    return;
  }
  const seen = boxSize().map((v) => v / viewScale());
  moveView(arrow[0] * MOVE * seen[0], arrow[1] * MOVE * seen[1]);
}

function onKey(event) {
  const is_for_field = event.target.closest("select, input:not([type=checkbox]), dialog");
  if (!byId("keys-on").checked || is_for_field || event.ctrlKey || event.altKey || event.metaKey) return;
  const key = event.key === "=" ? "+" : event.key;
  const found = KEYS.find(([known]) => known === key);
  if (!found) return;
  event.preventDefault();
  found[3]();
}

function followKeys() {
  fillList("help-keys", [...KEYS.map(([, name, meaning]) => [meaning, name]), ...ON_FRAME.map(([name, meaning]) => [meaning, name])]);
  document.addEventListener("keydown", onKey);
  byId("frame-box").addEventListener("keydown", onFrameKey);
  byId("help-button").addEventListener("click", openHelp);
  byId("help-close").addEventListener("click", () => byId("help").close());
  byId("theme").addEventListener("click", changeTheme);
}
