// Where the time goes: stages on a logarithmic scale against the time to the deadline; lateness on a linear one; all
// numbers as a table.

const SHORTEST_MS = 0.01;

function drawStages(state) {
  const { pen, width, height } = cleared(byId("stages"));
  const stages = state.run ? state.run.stages.filter((s) => s.count > 0 && (s.is_of_a_frame || s.name === "release_to_delivered")) : [];
  if (!stages.length) return;
  const longest = Math.max(state.readout_ms, ...stages.map((s) => s.max_ms));
  const decades = Math.ceil(Math.log10((longest * 1.2) / SHORTEST_MS));
  const [left, right, foot] = [112, 8, 15];
  const x = (ms) => left + ((width - left - right) * Math.log10(Math.max(ms, SHORTEST_MS) / SHORTEST_MS)) / decades;
  const step = Math.min((height - foot) / stages.length, 20);
  pen.fillStyle = colours.dim;
  pen.textAlign = "center";
  for (let decade = 0; decade <= decades; decade += 1) {
    const ms = SHORTEST_MS * 10 ** decade;
    pen.strokeStyle = colours.line;
    line(pen, [[x(ms), 0], [x(ms), stages.length * step]]);
    if (decade < decades) pen.fillText(shortMs(ms), x(ms), stages.length * step + 8);
  }
  stages.forEach((stage, i) => drawStage(pen, stage, x, [i * step, step], state.readout_ms));
  pen.strokeStyle = colours.amber;
  pen.setLineDash([4, 3]);
  line(pen, [[x(state.readout_ms), 0], [x(state.readout_ms), stages.length * step]]);
  pen.setLineDash([]);
}

function drawStage(pen, stage, x, [top, step], due_ms) {
  const middle = top + step / 2, thick = Math.max(step - 7, 3);
  pen.fillStyle = colours.text;
  pen.textAlign = "right";
  pen.fillText(stage.name.replaceAll("_", " ").replace("release to delivered", "all to delivered"), x(0) - 8, middle);
  const bar = (ms, alpha) => {
    pen.globalAlpha = alpha;
    pen.fillStyle = ms > due_ms ? colours.red : colours.blue;
    pen.fillRect(x(0), middle - thick / 2, Math.max(x(ms) - x(0), 1), thick);
  };
  bar(stage.p99_ms, 0.4);
  bar(stage.p50_ms, 0.8);
  pen.globalAlpha = 1;
  pen.fillStyle = stage.max_ms > due_ms ? colours.red : colours.text;
  pen.fillRect(x(stage.max_ms) - 1, middle - thick / 2, 2, thick);
}

// Limit of a stage: the bench's own, or for the whole way the time to the deadline.
function limitOf(stage, due_ms) {
  if (stage.limit_ms !== null) return stage.limit_ms;
  return stage.name === "release_to_delivered" ? due_ms : null;
}

function showTiming(state) {
  const stages = state.run.stages.filter((stage) => stage.count > 0);
  fillTable("timing", stages.map((stage) => {
    const limit = limitOf(stage, state.readout_ms);
    const share = limit === null ? null : stage.p99_ms / limit;
    const tone = share === null ? "" : share > 1 ? "bad" : "good";
    return [
      [spaced(stage.name), "name"],
      [String(stage.count), ""],
      ...[stage.mean_ms, stage.p50_ms, stage.p99_ms, stage.max_ms].map((ms) => [shortMs(ms), ""]),
      [limit === null ? "–" : shortMs(limit), ""],
      [share === null ? "–" : `${(100 * share).toPrecision(2)} % ${share > 1 ? "over" : "met"}`, tone],
      [histogramOf(stage), "spark"],
    ];
  }));
  byId("timing-facts").textContent = `${shortMs(state.readout_ms)} from the end of the exposure to the deadline`;
}

// Bars of how many times lay between two bounds, on a logarithmic scale.
function histogramOf(stage) {
  const canvas = document.createElement("canvas");
  const sums = [...stage.cumulative.map(([, sum]) => sum), stage.count];
  const counts = sums.map((sum, i) => sum - (i ? sums[i - 1] : 0)), most = Math.max(...counts, 1);
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", `Histogram of ${spaced(stage.name)}: ${describeBars(stage, counts)}`);
  [canvas.width, canvas.height] = [counts.length * 7, 20];
  const pen = canvas.getContext("2d");
  counts.forEach((count, i) => {
    const tall = count ? Math.max((19 * Math.log1p(count)) / Math.log1p(most), 2) : 1;
    pen.fillStyle = count ? colours.blue : colours.line;
    pen.fillRect(i * 7, 20 - tall, 6, tall);
  });
  return canvas;
}

function describeBars(stage, counts) {
  const upTo = (i) => (i < stage.cumulative.length ? "up to " + shortMs(stage.cumulative[i][0]) : "longer");
  return counts.flatMap((count, i) => (count ? [`${count} ${upTo(i)}`] : [])).join(", ");
}

function drawLateness(state) {
  const { pen, width, height } = cleared(byId("lateness"));
  if (!state.lateness) {
    byId("lateness-facts").textContent = "";
    return;
  }
  const { counts, reach_ms } = state.lateness;
  const foot = 15, step = width / counts.length, most = Math.max(...counts, 1);
  counts.forEach((count, i) => {
    if (!count) return;
    const tall = Math.max(((height - foot - 4) * Math.log1p(count)) / Math.log1p(most), 2);
    pen.fillStyle = i < counts.length / 2 ? colours.green : colours.red;
    pen.fillRect(i * step + 0.5, height - foot - tall, Math.max(step - 1, 1), tall);
  });
  pen.strokeStyle = colours.line;
  line(pen, [[0, height - foot], [width, height - foot]]);
  pen.strokeStyle = colours.amber;
  pen.setLineDash([4, 3]);
  line(pen, [[width / 2, 0], [width / 2, height - foot]]);
  pen.setLineDash([]);
  pen.fillStyle = colours.dim;
  pen.textAlign = "left";
  pen.fillText("-" + shortMs(reach_ms), 0, height - 6);
  pen.textAlign = "center";
  pen.fillText("due", width / 2, height - 6);
  pen.textAlign = "right";
  pen.fillText("+" + shortMs(reach_ms), width, height - 6);
  const [late, total] = lateOf(state.lateness);
  byId("lateness-facts").textContent = `${late} of ${total} late`;
}

// Frames after their deadline, and all.
function lateOf({ counts }) {
  const sum = (some) => some.reduce((a, b) => a + b, 0);
  return [sum(counts.slice(counts.length / 2)), sum(counts)];
}
