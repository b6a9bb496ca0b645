// Value, place and direction of one pixel: the one under the pointer, or the one that was chosen by a tap or by keys.

const pixel = { hovered: null, chosen: null, answered: "", isAsking: false };

const pixelWanted = () => pixel.hovered || pixel.chosen;

function inside(place) {
  const [x, y] = place.map(Math.round);
  return x >= 0 && y >= 0 && x < view.size[0] && y < view.size[1] ? [x, y] : null;
}

function hoverPixel(at) {
  pixel.hovered = at && inside(toFrame(at));
  byId("pixel").setAttribute("aria-live", "off");
  askPixel();
}

// The choice stays when the pointer leaves.
function choosePixel(at) {
  pixel.chosen = inside(toFrame(at));
  pixel.hovered = null;
  askPixel();
  drawOverlay();
}

function forgetPixel() {
  pixel.chosen = pixel.hovered = null;
  askPixel();
  drawOverlay();
}

// Moves the choice by keys; a first one is in the middle of what is seen.
function movePixel(columns, rows) {
  const from = pixel.chosen || [Math.floor(view.x), Math.floor(view.y)];
  const to = [from[0] + columns, from[1] + rows];
  pixel.chosen = to.map((v, i) => Math.min(Math.max(v, 0), view.size[i] - 1));
  pixel.hovered = null;
  byId("pixel").setAttribute("aria-live", "polite");
  const [at, box] = [toBox(pixel.chosen), boxSize()];
  const beyond = at.map((v, i) => (v < 0 ? v - 20 : v > box[i] ? v - box[i] + 20 : 0));
  if (beyond[0] || beyond[1]) moveView(beyond[0] / viewScale(), beyond[1] / viewScale());
  askPixel();
  drawOverlay();
}

const signed = (value, digits) => (value < 0 ? "−" : "+") + Math.abs(value).toFixed(digits);

function pixelText({ x_px, y_px, dn, ra_deg, dec_deg }) {
  const there = ra_deg === null ? "no sky map" : `RA ${ra_deg.toFixed(4)}° Dec ${signed(dec_deg, 4)}°`;
  return `x ${x_px} y ${y_px}: ${dn} DN · ${there}`;
}

// One request at a time, about the newest place.
async function askPixel() {
  const number = byId("frame").dataset.number, place = pixelWanted();
  if (!place || number === undefined) {
    byId("pixel").textContent = "point at a pixel or tap it";
    pixel.answered = "";
    return;
  }
  const wanted = `pixel.json?head=${chosenHead}&frame=${number}&x=${place[0]}&y=${place[1]}`;
  if (pixel.isAsking || pixel.answered === wanted) return;
  pixel.isAsking = true;
  try {
    const answer = await ask(wanted);
    byId("pixel").textContent = answer.ok ? pixelText(await answer.json()) : "this frame is not kept any more";
    pixel.answered = wanted;
  } catch {
    await pause(1000);
  }
  pixel.isAsking = false;
  askPixel();
}

// A cross at the pixel that was chosen.
function drawChosen(pen) {
  if (!pixel.chosen) return;
  const [x, y] = toBox(pixel.chosen), half = Math.max(viewScale() / 2, 4);
  pen.strokeStyle = colours["mark-choice"];
  pen.strokeRect(x - half, y - half, 2 * half, 2 * half);
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    line(pen, [[x + dx * half, y + dy * half], [x + dx * (half + 8), y + dy * (half + 8)]]);
  }
}
