// A frame, and over it its truth. The picture's canvas has one pixel per pixel of the frame.

const KIND_COLOUR = { star: "mark-star", target: "mark-target", false_star: "mark-false", proton_track: "mark-proton" };
const LABELS_MAX = 40;
let shownTruth = null;

// The part of the address that says how to stretch.
function stretchQuery() {
  const stretch = byId("stretch").value;
  byId("range").hidden = stretch !== "dn";
  if (stretch !== "dn") return "stretch=" + stretch;
  const within = (field, low, high) => Math.min(Math.max(Math.round(Number(field.value) || 0), low), high);
  const black = within(byId("black"), 0, 65534);
  return `stretch=dn&black=${black}&white=${within(byId("white"), black + 1, 65535)}`;
}

function drawFrame(picture, truth, number) {
  const canvas = byId("frame");
  if (canvas.width !== picture.width || canvas.height !== picture.height) {
    canvas.width = picture.width;
    canvas.height = picture.height;
  }
  canvas.getContext("2d").drawImage(picture, 0, 0);
  canvas.dataset.number = number;
  byId("shown").textContent = number;
  shownTruth = truth;
  newFrameSize([picture.width, picture.height]);
  showFacts();
  askPixel();
}

// Shows no picture: the one of another head must not stay under this one's name.
function clearFrame() {
  const canvas = byId("frame");
  canvas.getContext("2d").clearRect(0, 0, canvas.width, canvas.height);
  delete canvas.dataset.number;
  byId("shown").textContent = "";
  shownTruth = null;
  drawOverlay();
}

function drawOverlay() {
  const { pen, width, height } = cleared(byId("overlay"));
  const [left, top] = toBox([-0.5, -0.5]), [right, bottom] = toBox(view.size.map((v) => v - 0.5));
  const seen = [Math.max(left, 0), Math.max(top, 0), Math.min(right, width), Math.min(bottom, height)];
  pen.save();
  pen.beginPath();
  pen.rect(seen[0], seen[1], seen[2] - seen[0], seen[3] - seen[1]);
  pen.clip();
  if (shownTruth && byId("overlay-on").checked) drawTruth(pen, seen);
  if (shownTruth && byId("names-on").checked) drawNames(pen, seen);
  drawChosen(pen);
  pen.restore();
}

const isSeen = ([x, y], [left, top, right, bottom]) => x >= left && y >= top && x <= right && y <= bottom;

// Circles and magnitudes where the truth has something.
function drawTruth(pen, seen) {
  shownTruth.stars.forEach((star, place) => {
    const at = toBox([star.x_px, star.y_px]);
    if (!isSeen(at, seen)) return;
    const radius = ringOf(star);
    pen.strokeStyle = colours[KIND_COLOUR[star.kind]] || colours["mark-other"];
    pen.globalAlpha = place < LABELS_MAX ? 0.95 : 0.55;
    pen.beginPath();
    pen.arc(...at, radius, 0, 2 * Math.PI);
    pen.stroke();
    drawSmear(pen, star, at, viewScale());
    if (byId("labels-on").checked && place < LABELS_MAX && star.mag !== null) {
      const is_at_end = at[0] > seen[2] - 44;
      pen.fillStyle = pen.strokeStyle;
      pen.textAlign = is_at_end ? "right" : "left";
      pen.fillText(star.mag.toFixed(1), at[0] + (is_at_end ? -radius - 3 : radius + 3), at[1]);
    }
  });
  pen.globalAlpha = 1;
}

// Radius of the circle around a star, CSS px.
const ringOf = (star) => Math.min(Math.max(11 - star.mag, 4), 14);

// Where the names of stars are, CSS px: the middle of each text's left end or right end.
function placeNames(seen) {
  return shownTruth.stars.flatMap((star) => {
    const name = nameOf(star), [x, y] = toBox([star.x_px, star.y_px]);
    if (!name || !isSeen([x, y], seen)) return [];
    const is_left = x < seen[2] - 90, reach = ringOf(star) + 3;
    return [{ name, star, is_left, x: x + (is_left ? reach : -reach), y: y < seen[1] + 20 ? y + 14 : y - 12 }];
  });
}

function drawNames(pen, seen) {
  pen.save();
  pen.font = "600 12px system-ui, 'DejaVu Sans', sans-serif";
  pen.lineJoin = "round";
  pen.lineWidth = 3;
  pen.strokeStyle = "#000";
  pen.fillStyle = colours["mark-name"];
  for (const { name, is_left, x, y } of placeNames(seen)) {
    pen.textAlign = is_left ? "left" : "right";
    pen.strokeText(name, x, y);
    pen.fillText(name, x, y);
  }
  pen.restore();
}

// The path of objects that move by themselves.
function drawSmear(pen, star, [x, y], scale) {
  if (!(star.smear_px > 2)) return;
  const half = (star.smear_px * scale) / 2, angle = (star.smear_deg * Math.PI) / 180;
  const [dx, dy] = [half * Math.cos(angle), half * Math.sin(angle)];
  line(pen, [[x - dx, y - dy], [x + dx, y + dy]]);
}

function showNoFrame() {
  for (const name of ["number", "utc"]) byId(name).textContent = "–";
  for (const name of ["frame-facts", "pointing"]) byId(name).textContent = "\u00a0";
  byId("faults").replaceChildren();
}

// The facts of the frame that is shown.
function showFacts() {
  const frame = shownTruth && shownTruth.facts;
  if (!frame) return;
  const left_out = frame.left_out_stars ? `, ${frame.left_out_stars} left out` : "";
  byId("frame-facts").textContent =
    `${frame.stars} stars${left_out} · exposure ${shortMs(frame.exposure_s * 1000)} · ${frame.method} on ${frame.backend}` +
    ` · attitude ${frame.origin}, ${shortMs(Math.max(frame.attitude_age_ms, 0))} old · degradation ${frame.rung}`;
  byId("frame").setAttribute("aria-label", `Frame ${frame.number} of ${lastState.name} with ${frame.stars} stars`);
}
