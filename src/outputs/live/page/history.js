// Pause, and steps through the frames that the program keeps of those a page has asked for. The run goes on.

// Number of the frame that is held; null: the newest is shown.
let heldFrame = null;

const keptFrames = () => (lastState ? lastState.kept_frames : []);

function shownNumber() {
  const number = byId("frame").dataset.number;
  return number === undefined ? null : Number(number);
}

function hold(number) {
  if (number === null || number === undefined) return;
  heldFrame = number;
  showHeld();
  wakePicture();
}

function resume() {
  heldFrame = null;
  pictureOf = null;
  showHeld();
  wakePicture();
}

const togglePause = () => (heldFrame === null ? hold(shownNumber()) : resume());

// Shows the frame before or after the one that is shown; the first step holds it.
function step(by) {
  const kept = keptFrames();
  const from = kept.indexOf(heldFrame === null ? shownNumber() : heldFrame);
  if (from < 0) {
    hold(kept[kept.length - 1]);
    return;
  }
  hold(kept[Math.min(Math.max(from + by, 0), kept.length - 1)]);
}

function showHeld() {
  const kept = keptFrames();
  const at = kept.indexOf(heldFrame);
  byId("pause").setAttribute("aria-pressed", String(heldFrame !== null));
  byId("pause").textContent = heldFrame === null ? "pause" : "go on";
  const place = at < 0 ? "not kept any more" : `${at + 1} of ${kept.length} kept`;
  const text = heldFrame === null ? "" : `held, ${place}`;
  if (byId("held").textContent !== text) byId("held").textContent = text;
  byId("frame-panel").classList.toggle("is-held", heldFrame !== null);
}

function followHistory() {
  byId("pause").addEventListener("click", togglePause);
  byId("back").addEventListener("click", () => step(-1));
  byId("forth").addEventListener("click", () => step(1));
}
