// Asks for the state and for the picture, each again when the last answer has come; says when nothing comes any more.

const STATE_EVERY_MS = 250;
const PICTURE_EVERY_MS = 200;
const PICTURE_EVERY_MS_CALM = 1000;
// Time without an answer after which the signal is lost, ms.
const LOST_AFTER_MS = 1500;
let lastState = null;
let lastAnswer = performance.now();
let pictureOf = null;

const pause = (ms) => new Promise((done) => setTimeout(done, ms));

// Ends the pause before the next picture.
let wakePicture = () => {};

function pauseBeforePicture() {
  const ms = wantsLittleMotion.matches ? PICTURE_EVERY_MS_CALM : PICTURE_EVERY_MS;
  return new Promise((done) => {
    wakePicture = done;
    setTimeout(done, ms);
  });
}

async function ask(address) {
  const answer = await fetch(address, { cache: "no-store", signal: AbortSignal.timeout(8000) });
  lastAnswer = performance.now();
  return answer;
}

function show(state) {
  // An answer from before another head was chosen.
  if (state.head !== chosenHead) return;
  lastState = state;
  const head = state.heads.length > 1 ? ` · ${state.name}` : "";
  byId("bench").textContent = `${state.bench} · ${state.camera}${head}`;
  document.title = state.frame ? `starloop ${state.frame.number}` : "starloop";
  if (state.run) {
    showCounts(state.run);
    byId("of").textContent = state.run.frames_in_run ? " of " + state.run.frames_in_run : "";
  }
  if (state.frame) {
    byId("number").textContent = state.frame.number;
    byId("utc").textContent = state.frame.utc.replace("T", " ").replace(/(\.\d{3})\d*Z$/, "$1 UTC");
    showPointing(state.frame);
    showFaults(state.frame);
  } else {
    showNoFrame();
  }
  state.heads.forEach(rememberPointing);
  showHeads(state.heads);
  showHeld();
  drawAll();
}

function drawAll() {
  if (!lastState) return;
  const page = chosenPage();
  if (page === "events" && lastState.run) showEvents(lastState.run);
  if (page === "timing" && lastState.run) showTiming(lastState);
  if (page !== "view") return;
  drawSky(lastState);
  drawStages(lastState);
  drawLateness(lastState);
}

// Returns the state of the signal: a word for the style, and a sentence.
function signal() {
  const frame = lastState && lastState.frame;
  const clock = (utc) => utc.slice(11, 19) + " UTC";
  // The program ends soon after its run: a missing answer then is not a loss of signal.
  if (lastState && lastState.is_over) return ["over", `run is over since ${clock(frame ? frame.taken_utc : lastState.now_utc)}`];
  if (performance.now() - lastAnswer > LOST_AFTER_MS) {
    return ["lost", frame ? `no signal since ${clock(frame.taken_utc)}` : "no signal"];
  }
  if (!frame) return ["quiet", "waiting for the first frame"];
  if (isStale(lastState)) return ["stale", `no new frame since ${clock(frame.taken_utc)}`];
  return ["live", "live"];
}

function showSignal() {
  const [word, text] = signal();
  const status = byId("status");
  if (status.textContent !== text) status.textContent = text;
  status.className = word;
  document.body.classList.toggle("no-signal", word === "lost");
}

async function followState() {
  for (;;) {
    try {
      const answer = await ask("state.json?head=" + chosenHead);
      if (answer.ok) show(await answer.json());
      // Another run listens here now, with fewer heads.
      if (answer.status === 404) chooseHead(0);
    } catch (_no_one_answers) {
      await pause(1000);
    }
    showSignal();
    await pause(STATE_EVERY_MS);
  }
}

async function newPicture() {
  const head = chosenHead, held = heldFrame;
  const wanted = `head=${head}&${stretchQuery()}${held === null ? "" : "&frame=" + held}`;
  const newest = lastState && lastState.head === head && lastState.frame ? lastState.frame.count : 0;
  const count = held === null ? newest : "held";
  if (!count || pictureOf === `${count} ${wanted}`) return;
  if (held !== null && !keptFrames().includes(held)) return;
  const answer = await ask("frame.png?" + wanted);
  if (!answer.ok) return;
  const number = answer.headers.get("starloop-frame");
  const picture = await createImageBitmap(await answer.blob());
  const answered = await ask(`truth.json?head=${head}&frame=${number}`);
  const truth = answered.ok ? await answered.json() : null;
  // Another head or frame was chosen meanwhile.
  if (head !== chosenHead || held !== heldFrame) return;
  drawFrame(picture, truth, number);
  drawTile(head, picture);
  pictureOf = `${count} ${wanted}`;
}

async function followPicture() {
  for (;;) {
    try {
      await newPicture();
      await newTilePicture();
    } catch (_no_one_answers) {
      await pause(1000);
    }
    await pauseBeforePicture();
  }
}

for (const control of ["overlay-on", "labels-on", "names-on"]) byId(control).addEventListener("change", drawOverlay);
byId("stretch").addEventListener("change", stretchQuery);
window.addEventListener("resize", () => {
  placeFrame();
  drawAll();
});
followFingers();
followHistory();
followTabs();
followKeys();
setInterval(showSignal, 500);
followState();
followPicture();
