// The whole sky in Hammer's equal-area projection, east to the left as seen from within, 0 h in the middle: grid, ecliptic,
// galactic plane, the boresight's trail, the field's outline with its upper side marked.

const DEG = Math.PI / 180;
const TRAIL_MAX = 900;
// By head.
const trails = new Map();

// North galactic pole and obliquity of the ecliptic, ICRF axes (J2000), deg.
const GALACTIC_POLE = [192.85948, 27.12825];
const ECLIPTIC_POLE = [270, 90 - 23.4392911];

const unit = (ra, dec) => [Math.cos(dec * DEG) * Math.cos(ra * DEG), Math.cos(dec * DEG) * Math.sin(ra * DEG), Math.sin(dec * DEG)];
const raDec = ([x, y, z]) => [Math.atan2(y, x) / DEG, Math.atan2(z, Math.hypot(x, y)) / DEG];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (a, k) => a.map((v) => v * k);
const sum = (a, b) => a.map((v, i) => v + b[i]);
const normal = (a) => scaled(a, 1 / Math.hypot(...a));

// -2 sqrt 2 .. 2 sqrt 2 to the left and -sqrt 2 .. sqrt 2 upwards.
function hammer(ra, dec) {
  const half = ((((ra + 180) % 360) + 360) % 360 - 180) * DEG / 2, up = dec * DEG;
  const depth = Math.sqrt(1 + Math.cos(up) * Math.cos(half));
  return [-2 * Math.SQRT2 * Math.cos(up) * Math.sin(half) / depth, Math.SQRT2 * Math.sin(up) / depth];
}

// v in ICRF axes of a direction in sensor axes: q* v q, as v_sensor = q v q*.
function icrfFromSensor([w, x, y, z], v) {
  const axis = [-x, -y, -z];
  const twice = scaled(cross(axis, v), 2);
  return sum(sum(v, scaled(twice, w)), cross(axis, twice));
}

function greatCircle(pole) {
  const axis = unit(...pole);
  const first = normal(cross(axis, Math.abs(axis[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
  const second = cross(axis, first);
  return Array.from({ length: 181 }, (_, i) => {
    const angle = i * 2 * DEG;
    return raDec(sum(scaled(first, Math.cos(angle)), scaled(second, Math.sin(angle))));
  });
}

const parallels = [-60, -30, 0, 30, 60].map((dec) => Array.from({ length: 121 }, (_, i) => [-180 + i * 3, dec]));
const meridians = Array.from({ length: 12 }, (_, h) => Array.from({ length: 61 }, (_, i) => [h * 30 + 1e-6, -90 + i * 3]));
const galactic = greatCircle(GALACTIC_POLE);
const ecliptic = greatCircle(ECLIPTIC_POLE);

// The field's border: right ascension and declination along its four sides, the upper one first.
function fieldOutline(attitude, [across, down]) {
  const [x, y] = [Math.tan((across * DEG) / 2), Math.tan((down * DEG) / 2)];
  const corners = [[-x, -y], [x, -y], [x, y], [-x, y], [-x, -y]];
  const side = (from, to) => Array.from({ length: 13 }, (_, i) => {
    const t = i / 12;
    return raDec(icrfFromSensor(attitude, [from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1]), 1]));
  });
  return [0, 1, 2, 3].map((i) => side(corners[i], corners[i + 1]));
}

function rememberPointing({ head, frame }) {
  if (!frame || frame.ra_deg === null || frame.dec_deg === null) return;
  if (!trails.has(head)) trails.set(head, []);
  const trail = trails.get(head);
  const last = trail[trail.length - 1];
  if (last && Math.abs(last[0] - frame.ra_deg) < 0.02 && Math.abs(last[1] - frame.dec_deg) < 0.02) return;
  trail.push([frame.ra_deg, frame.dec_deg]);
  if (trail.length > TRAIL_MAX) trail.shift();
}

function drawSky(state) {
  const { pen, width, height } = cleared(byId("sky"));
  const scale = Math.min((width - 60) / (4 * Math.SQRT2), (height - 8) / (2 * Math.SQRT2));
  const place = ([ra, dec]) => {
    const [x, y] = hammer(ra, dec);
    return [width / 2 + x * scale, height / 2 - y * scale];
  };
  // A line that leaves on one side and comes back on the other is two.
  const draw = (points) => {
    let part = [];
    for (const point of points.map(place)) {
      const last = part[part.length - 1];
      if (last && Math.abs(point[0] - last[0]) > scale) {
        line(pen, part);
        part = [];
      }
      part.push(point);
    }
    if (part.length > 1) line(pen, part);
  };
  pen.fillStyle = colours.ground;
  pen.beginPath();
  pen.ellipse(width / 2, height / 2, 2 * Math.SQRT2 * scale, Math.SQRT2 * scale, 0, 0, 2 * Math.PI);
  pen.fill();
  pen.lineWidth = 1;
  pen.strokeStyle = colours.line;
  pen.stroke();
  parallels.forEach(draw);
  meridians.forEach(draw);
  drawNamedCircles(pen, draw);
  drawGridLabels(pen, place);
  drawLegend(pen, height);
  const seen = (head) => head.frame && head.frame.ra_deg !== null;
  state.heads.filter((head) => head.head !== state.head && seen(head)).forEach((head) => drawOtherField(pen, draw, head));
  if (seen(state)) drawField(pen, place, draw, state);
}

function drawNamedCircles(pen, draw) {
  pen.strokeStyle = colours.galaxy;
  pen.lineWidth = 3;
  draw(galactic);
  pen.lineWidth = 1;
  pen.setLineDash([3, 4]);
  pen.strokeStyle = colours.ecliptic;
  draw(ecliptic);
  pen.setLineDash([]);
}

function drawGridLabels(pen, place) {
  pen.fillStyle = colours.dim;
  pen.textAlign = "center";
  for (let hours = 0; hours < 24; hours += 4) {
    if (hours !== 12) pen.fillText(hours + " h", ...place([hours * 15, 0]).map((v, i) => v + (i ? 8 : 0)));
  }
  for (const dec of [-60, -30, 30, 60]) {
    const [x, y] = place([179.999, dec]);
    pen.fillText((dec > 0 ? "+" : "") + dec + "°", x - 18, y);
  }
}

function drawLegend(pen, height) {
  const entries = [["galactic plane", colours.galaxy], ["ecliptic", colours.ecliptic], ["field, its upper side", colours.amber]];
  pen.textAlign = "left";
  entries.forEach(([text, tone], i) => {
    pen.fillStyle = tone;
    pen.fillText(text, 0, height - 38 + 15 * i);
  });
}

// The field of a head that is not the chosen one.
function drawOtherField(pen, draw, { frame, field_deg }) {
  pen.strokeStyle = colours.dim;
  pen.lineWidth = 1;
  fieldOutline(frame.attitude_wxyz, field_deg).forEach(draw);
}

function drawField(pen, place, draw, state) {
  const frame = state.frame;
  pen.lineJoin = "round";
  pen.strokeStyle = colours.blue;
  pen.globalAlpha = 0.5;
  draw(trails.get(state.head) || []);
  pen.globalAlpha = 1;
  pen.lineWidth = 1.5;
  pen.strokeStyle = colours.text;
  const [upper, ...others] = fieldOutline(frame.attitude_wxyz, state.field_deg);
  others.forEach(draw);
  pen.lineWidth = 3;
  pen.strokeStyle = colours.amber;
  draw(upper);
  pen.lineWidth = 1;
  pen.fillStyle = colours.amber;
  pen.beginPath();
  pen.arc(...place([frame.ra_deg, frame.dec_deg]), 2.5, 0, 2 * Math.PI);
  pen.fill();
}

function showPointing(frame) {
  const rate = Math.hypot(...frame.rate_deg_s.map((r) => r || 0));
  const text = `RA ${fixed(frame.ra_deg, 4)}°  Dec ${fixed(frame.dec_deg, 4)}°  roll ${fixed(frame.roll_deg, 2)}°  rate ${rate.toPrecision(3)}°/s`;
  byId("pointing").textContent = text;
  byId("sky").setAttribute("aria-label", "Map of the whole sky; boresight at " + text);
}
