// Several camera heads: a tile each, with its newest picture and its own numbers. The chosen head is shown large.

let chosenHead = 0;
let lastTile = 0;

function newTile(number) {
  const tile = document.createElement("button");
  tile.type = "button";
  tile.className = "tile";
  const picture = document.createElement("canvas");
  picture.setAttribute("aria-hidden", "true");
  tile.append(picture);
  for (const part of ["name", "facts", "late"]) {
    const text = document.createElement("span");
    text.className = part;
    tile.append(text);
  }
  tile.addEventListener("click", () => chooseHead(number));
  return tile;
}

// Shows another head large; what is known of it already is shown at once.
function chooseHead(number) {
  if (number === chosenHead) return;
  chosenHead = number;
  pictureOf = null;
  clearFrame();
  if (lastState && lastState.heads[number]) show({ ...lastState, ...lastState.heads[number], is_over: lastState.is_over });
}

function tellHeads(heads) {
  const list = byId("heads");
  list.hidden = heads.length < 2;
  const wanted = list.hidden ? 0 : heads.length;
  while (list.children.length > wanted) list.lastChild.remove();
  while (list.children.length < wanted) list.append(newTile(list.children.length));
  heads.slice(0, wanted).forEach((head, i) => tellTile(list.children[i], head));
}

function tellTile(tile, head) {
  const text = (part, words) => (tile.querySelector("." + part).textContent = words);
  const frame = head.frame;
  tile.setAttribute("aria-pressed", String(head.head === chosenHead));
  tile.classList.toggle("stale", !head.is_over && isStale(head));
  tile.title = `${head.name} · ${head.camera}`;
  text("name", head.name);
  if (!frame) {
    text("facts", "no frame yet");
    text("late", "");
    return;
  }
  const [late, total] = lateOf(head.lateness);
  const faults = frame.fault_flags.length ? ` · faults ${frame.fault_flags.map(spaced).join(", ")}` : "";
  text("facts", `frame ${frame.number} · ${frame.stars} stars`);
  text("late", `${late} of ${total} late${faults}`);
}

// A head that sends nothing while the others may go on.
function isStale(head) {
  return head.frame !== null && head.frame.age_s > Math.max(2, (3 * head.frame_period_ms) / 1000);
}

function drawTile(head, picture) {
  const tile = byId("heads").children[head];
  if (!tile) return;
  const canvas = tile.querySelector("canvas");
  const wide = canvas.clientWidth || 96;
  canvas.width = Math.round(wide * (window.devicePixelRatio || 1));
  canvas.height = Math.max(Math.round((canvas.width * picture.height) / picture.width), 1);
  const pen = canvas.getContext("2d");
  pen.imageSmoothingQuality = "high";
  pen.drawImage(picture, 0, 0, canvas.width, canvas.height);
}

// The picture of one tile, another one each time; the chosen head's comes with the large picture.
async function newTilePicture() {
  const heads = lastState ? lastState.heads : [];
  const others = heads.filter((head) => head.head !== chosenHead && head.frame);
  if (!others.length) return;
  const { head, frame } = others.find((other) => other.head > lastTile) || others[0];
  lastTile = head;
  const tile = byId("heads").children[head];
  const wanted = `head=${head}&${stretchQuery()}`;
  if (!tile || tile.dataset.picture === `${frame.count} ${wanted}`) return;
  const answer = await ask("frame.png?" + wanted);
  if (!answer.ok) return;
  drawTile(head, await createImageBitmap(await answer.blob()));
  tile.dataset.picture = `${frame.count} ${wanted}`;
  tile.dataset.number = answer.headers.get("starloop-frame");
}
