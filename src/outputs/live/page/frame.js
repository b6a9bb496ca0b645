// The newest frame, and over it its truth. The picture's canvas has one pixel per pixel of the frame.

const KIND_COLOUR = { star: "blue", target: "amber", false_star: "red", proton_track: "violet" };
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

// Makes the box as large as fits, in the frame's proportions.
function fitFrame([columns, rows]) {
  const box = byId("frame-box"), stack = byId("frame-stack");
  const scale = Math.min(box.clientWidth / columns, box.clientHeight / rows);
  // Enlarged pixels stay squares; a frame that is made smaller must not lose the pixels of a star.
  byId("frame").style.imageRendering = scale > 1 ? "pixelated" : "auto";
  stack.style.width = Math.floor(columns * scale) + "px";
  stack.style.height = Math.floor(rows * scale) + "px";
}

function drawFrame(picture, truth) {
  const canvas = byId("frame");
  if (canvas.width !== picture.width || canvas.height !== picture.height) {
    canvas.width = picture.width;
    canvas.height = picture.height;
  }
  fitFrame([picture.width, picture.height]);
  canvas.getContext("2d").drawImage(picture, 0, 0);
  shownTruth = truth;
  drawOverlay();
}

// Shows no picture: the one of another head must not stay under this one's name.
function clearFrame() {
  const canvas = byId("frame");
  canvas.getContext("2d").clearRect(0, 0, canvas.width, canvas.height);
  delete canvas.dataset.number;
  shownTruth = null;
  drawOverlay();
}

function drawOverlay() {
  const { pen, width, height } = cleared(byId("overlay"));
  if (!shownTruth || !byId("overlay-on").checked) return;
  const [columns, rows] = shownTruth.size_px;
  // The first pixel's centre is (0, 0), its corner half a pixel before.
  const x = (px) => ((px + 0.5) * width) / columns, y = (px) => ((px + 0.5) * height) / rows;
  shownTruth.stars.forEach((star, place) => {
    const [at_x, at_y] = [x(star.x_px), y(star.y_px)];
    if (at_x < 0 || at_y < 0 || at_x > width || at_y > height) return;
    const radius = Math.min(Math.max(11 - star.mag, 4), 14);
    pen.strokeStyle = colours[KIND_COLOUR[star.kind]] || colours.text;
    pen.globalAlpha = place < LABELS_MAX ? 0.95 : 0.55;
    pen.beginPath();
    pen.arc(at_x, at_y, radius, 0, 2 * Math.PI);
    pen.stroke();
    drawSmear(pen, star, [at_x, at_y], width / columns);
    if (byId("labels-on").checked && place < LABELS_MAX && star.mag !== null) {
      pen.fillStyle = pen.strokeStyle;
      pen.textAlign = at_x > width - 44 ? "right" : "left";
      pen.fillText(star.mag.toFixed(1), at_x + (at_x > width - 44 ? -radius - 3 : radius + 3), at_y);
    }
  });
  pen.globalAlpha = 1;
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

function showFrame(state) {
  const frame = state.frame;
  const left_out = frame.left_out_stars ? `, ${frame.left_out_stars} left out` : "";
  byId("frame-facts").textContent =
    `${frame.stars} stars${left_out} · exposure ${shortMs(frame.exposure_s * 1000)} · ${frame.method} on ${frame.backend}` +
    ` · attitude ${frame.origin}, ${shortMs(Math.max(frame.attitude_age_ms, 0))} old · degradation ${frame.rung}`;
  byId("frame").setAttribute("aria-label", `Frame ${frame.number} of ${state.name} with ${frame.stars} stars`);
}
