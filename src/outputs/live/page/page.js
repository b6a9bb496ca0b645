// Asks for the state and for the picture, each again when the last answer has come; says when nothing comes any more.

const STATE_EVERY_MS = 250;
const PICTURE_EVERY_MS = 200;
// Without an answer for so long there is no signal.
const LOST_AFTER_MS = 1500;
let lastState = null;
let lastAnswer = performance.now();
let pictureOf = null;

const pause = (ms) => new Promise((done) => setTimeout(done, ms));

async function ask(address) {
  const answer = await fetch(address, { cache: "no-store", signal: AbortSignal.timeout(8000) });
  lastAnswer = performance.now();
  return answer;
}

function show(state) {
  lastState = state;
  byId("bench").textContent = `${state.bench} · ${state.camera}`;
  document.title = state.frame ? `starloop ${state.frame.number}` : "starloop";
  if (state.run) {
    tellCounts(state.run);
    byId("of").textContent = state.run.frames_in_run ? " of " + state.run.frames_in_run : "";
  }
  if (state.frame) {
    byId("number").textContent = state.frame.number;
    byId("utc").textContent = state.frame.utc.replace("T", " ").replace(/(\.\d{3})\d*Z$/, "$1 UTC");
    tellFrame(state);
    tellPointing(state.frame);
    tellFaults(state.frame);
    rememberPointing(state.frame);
  }
  drawAll();
}

function drawAll() {
  if (!lastState) return;
  drawSky(lastState);
  drawStages(lastState);
  drawLateness(lastState);
}

// What is known of the signal: a word for the style, and a sentence.
function signal() {
  const frame = lastState && lastState.frame;
  const clock = (utc) => utc.slice(11, 19) + " UTC";
  // The program ends soon after its run: that nobody answers then is no loss of signal.
  if (lastState && lastState.is_over) return ["over", `run is over since ${clock(frame ? frame.taken_utc : lastState.now_utc)}`];
  if (performance.now() - lastAnswer > LOST_AFTER_MS) {
    return ["lost", frame ? `no signal since ${clock(frame.taken_utc)}` : "no signal"];
  }
  if (!frame) return ["quiet", "waiting for the first frame"];
  const quiet_s = Math.max(2, (3 * lastState.frame_period_ms) / 1000);
  if (frame.age_s > quiet_s) return ["stale", `no new frame since ${clock(frame.taken_utc)}`];
  return ["live", "live"];
}

function tellSignal() {
  const [word, text] = signal();
  const status = byId("status");
  if (status.textContent !== text) status.textContent = text;
  status.className = word;
  document.body.classList.toggle("no-signal", word === "lost");
}

async function followState() {
  for (;;) {
    try {
      const answer = await ask("state.json");
      if (answer.ok) show(await answer.json());
    } catch (_nobody_answers) {
      await pause(1000);
    }
    tellSignal();
    await pause(STATE_EVERY_MS);
  }
}

async function newPicture() {
  const wanted = stretchQuery();
  const count = lastState && lastState.frame ? lastState.frame.count : 0;
  if (!count || pictureOf === `${count} ${wanted}`) return;
  const answer = await ask("frame.png?" + wanted);
  if (!answer.ok) return;
  const number = answer.headers.get("starloop-frame");
  const picture = await createImageBitmap(await answer.blob());
  const truth = await ask("truth.json?frame=" + number);
  drawFrame(picture, truth.ok ? await truth.json() : null);
  byId("frame").dataset.number = number;
  pictureOf = `${count} ${wanted}`;
}

async function followPicture() {
  for (;;) {
    try {
      await newPicture();
    } catch (_nobody_answers) {
      await pause(1000);
    }
    await pause(PICTURE_EVERY_MS);
  }
}

for (const control of ["overlay-on", "labels-on"]) byId(control).addEventListener("change", drawOverlay);
byId("stretch").addEventListener("change", stretchQuery);
window.addEventListener("resize", () => {
  const frame = byId("frame");
  fitFrame([frame.width, frame.height]);
  drawOverlay();
  drawAll();
});
setInterval(tellSignal, 500);
followState();
followPicture();
