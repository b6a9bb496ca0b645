// Helpers of every drawing: elements by name, colours of the style sheet, canvases as large as they are shown.

const byId = (name) => document.getElementById(name);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
const COLOURS = ["ground", "panel", "line", "text", "dim", "blue", "green", "amber", "red", "violet", "galaxy", "ecliptic"];
const MARKS = ["mark-star", "mark-target", "mark-false", "mark-proton", "mark-other", "mark-name", "mark-choice"];
const colours = {};

function readColours() {
  for (const name of [...COLOURS, ...MARKS]) colours[name] = colour(name);
}
readColours();

// Clears a canvas, as many device pixels as it is shown with, and gives it back with its size in CSS pixels.
function cleared(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  const [columns, rows] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== columns || canvas.height !== rows) {
    canvas.width = columns;
    canvas.height = rows;
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "11px system-ui, 'DejaVu Sans', sans-serif";
  pen.textBaseline = "middle";
  return { pen, width, height };
}

function line(pen, points) {
  pen.beginPath();
  points.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.stroke();
}

// Returns a time with as few digits as needed.
function shortMs(ms) {
  if (ms >= 1000) return (ms / 1000).toPrecision(3) + " s";
  if (ms >= 1 || ms === 0) return Number(ms.toPrecision(3)) + " ms";
  return Number((ms * 1000).toPrecision(2)) + " µs";
}

const fixed = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits));
