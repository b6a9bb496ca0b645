// Which part of the frame is seen, and how large: buttons, wheel, two fingers, dragging.

const ZOOM_MOST = 64;
const ZOOM_STEP = 1.5;
// A press that moves less is a choice of a pixel, px.
const CLICK_PX = 5;
// `zoom` is 1 where the whole frame fits; x and y are the middle, columns and rows from the corner of the frame.
const view = { zoom: 1, x: 0.5, y: 0.5, size: [1, 1] };
const fingers = new Map();
let moved = 0;

function boxSize() {
  const box = byId("frame-box");
  return [box.clientWidth, box.clientHeight];
}

// Returns CSS pixels per pixel of the frame.
function viewScale() {
  const [wide, high] = boxSize();
  return view.zoom * Math.min(wide / view.size[0], high / view.size[1]);
}

// The first pixel's centre is (0, 0), its corner half a pixel before.
function toBox([x, y]) {
  const scale = viewScale(), [wide, high] = boxSize();
  return [wide / 2 + (x + 0.5 - view.x) * scale, high / 2 + (y + 0.5 - view.y) * scale];
}

function toFrame([x, y]) {
  const scale = viewScale(), [wide, high] = boxSize();
  return [view.x + (x - wide / 2) / scale - 0.5, view.y + (y - high / 2) / scale - 0.5];
}

// Keeps the frame in the box, and puts its canvas there.
function placeFrame() {
  const scale = viewScale(), box = boxSize();
  // Another page is shown.
  if (!scale) return;
  ["x", "y"].forEach((axis, i) => {
    const half = Math.min(box[i] / scale / 2, view.size[i] / 2);
    view[axis] = Math.min(Math.max(view[axis], half), view.size[i] - half);
  });
  const [left, top] = toBox([-0.5, -0.5]), style = byId("frame").style;
  // Enlarged pixels stay squares; a frame that is made smaller must not lose the pixels of a star.
  style.imageRendering = scale > 1 ? "pixelated" : "auto";
  style.left = left + "px";
  style.top = top + "px";
  style.width = view.size[0] * scale + "px";
  style.height = view.size[1] * scale + "px";
  // One finger moves the page while the whole frame is seen.
  byId("frame-box").style.touchAction = view.zoom > 1 ? "none" : "pan-y";
  byId("zoom-whole").textContent = view.zoom > 1 ? view.zoom.toFixed(1) + "×" : "whole";
  drawOverlay();
}

function newFrameSize(size) {
  if (size[0] !== view.size[0] || size[1] !== view.size[1]) Object.assign(view, { zoom: 1, size });
  placeFrame();
}

// The place under `at`, the middle of the box where it is left out, stays where it is.
function zoomBy(factor, at = boxSize().map((v) => v / 2)) {
  const [x, y] = toFrame(at);
  view.zoom = Math.min(Math.max(view.zoom * factor, 1), ZOOM_MOST);
  const [new_x, new_y] = toFrame(at);
  moveView(x - new_x, y - new_y);
}

function moveView(columns, rows) {
  view.x += columns;
  view.y += rows;
  placeFrame();
}

function showWhole() {
  view.zoom = 1;
  placeFrame();
}

function placeInBox(event) {
  const { left, top } = byId("frame-box").getBoundingClientRect();
  return [event.clientX - left, event.clientY - top];
}

function spread() {
  const [a, b] = [...fingers.values()];
  return { apart: Math.hypot(a[0] - b[0], a[1] - b[1]), middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2] };
}

function onFinger(event) {
  const now = placeInBox(event), before = fingers.get(event.pointerId);
  if (!before) {
    hoverPixel(now);
    return;
  }
  const two = fingers.size === 2 ? spread() : null;
  fingers.set(event.pointerId, now);
  const by = [now[0] - before[0], now[1] - before[1]];
  moved += Math.hypot(...by);
  if (two) {
    const then = spread();
    zoomBy(then.apart / Math.max(two.apart, 1), then.middle);
    moveView((two.middle[0] - then.middle[0]) / viewScale(), (two.middle[1] - then.middle[1]) / viewScale());
  } else if (fingers.size === 1 && moved > CLICK_PX) {
    moveView(-by[0] / viewScale(), -by[1] / viewScale());
  }
}

function followFingers() {
  const box = byId("frame-box");
  box.addEventListener("pointerdown", (event) => {
    if (!fingers.size) moved = 0;
    if (fingers.size < 2) fingers.set(event.pointerId, placeInBox(event));
    box.setPointerCapture(event.pointerId);
  });
  box.addEventListener("pointermove", onFinger);
  const lift = (event) => {
    const was_one = fingers.delete(event.pointerId) && !fingers.size;
    if (was_one && event.type === "pointerup" && moved <= CLICK_PX) choosePixel(placeInBox(event));
  };
  box.addEventListener("pointerup", lift);
  box.addEventListener("pointercancel", lift);
  box.addEventListener("pointerleave", () => hoverPixel(null));
  const onWheel = (event) => {
    event.preventDefault();
    zoomBy(Math.exp(-Math.max(-120, Math.min(120, event.deltaY)) / 300), placeInBox(event));
  };
  box.addEventListener("wheel", onWheel, { passive: false });
  byId("zoom-in").addEventListener("click", () => zoomBy(ZOOM_STEP));
  byId("zoom-out").addEventListener("click", () => zoomBy(1 / ZOOM_STEP));
  byId("zoom-whole").addEventListener("click", showWhole);
}
