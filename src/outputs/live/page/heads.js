// Several camera heads: a tile each, with its newest picture and its own numbers. The chosen head is shown large.

// Columns or rows of a small picture at most.
const TILE_PX = 144;

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

// Shows another head large; its last data are shown at once.
function chooseHead(number) {
  if (number === chosenHead) return;
  chosenHead = number;
  clearFrame();
  forgetPixel();
  resume();
  if (lastState && lastState.heads[number]) show({ ...lastState, ...lastState.heads[number], is_over: lastState.is_over });
}

function showHeads(heads) {
  const list = byId("heads");
  list.hidden = heads.length < 2;
  const wanted = list.hidden ? 0 : heads.length;
  while (list.children.length > wanted) list.lastChild.remove();
  while (list.children.length < wanted) list.append(newTile(list.children.length));
  heads.slice(0, wanted).forEach((head, i) => showTile(list.children[i], head));
}

function showTile(tile, head) {
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

// Draws a small picture in which each pixel is the brightest of those it is made of: a mean would lose the stars.
function drawTile(head, picture) {
  const tile = byId("heads").children[head];
  if (!tile) return;
  const { width, height } = picture;
  const step = Math.max(Math.ceil(Math.max(width, height) / TILE_PX), 1);
  const whole = new OffscreenCanvas(width, height).getContext("2d");
  whole.drawImage(picture, 0, 0);
  const from = whole.getImageData(0, 0, width, height).data;
  const canvas = tile.querySelector("canvas");
  [canvas.width, canvas.height] = [Math.ceil(width / step), Math.ceil(height / step)];
  const pen = canvas.getContext("2d");
  const small = pen.createImageData(canvas.width, canvas.height);
  for (let y = 0; y < height; y += 1) {
    for (let x = 0; x < width; x += 1) {
      const to = 4 * (Math.floor(y / step) * canvas.width + Math.floor(x / step));
      small.data[to] = Math.max(small.data[to], from[4 * (y * width + x)]);
    }
  }
  for (let at = 0; at < small.data.length; at += 4) {
    small.data[at + 1] = small.data[at + 2] = small.data[at];
    small.data[at + 3] = 255;
  }
  pen.putImageData(small, 0, 0);
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
