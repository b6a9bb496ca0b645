// Counts as lists: frames, the bus by port, events, faults.

const FRAME_COUNTS = ["scheduled", "rendered", "delivered", "late", "held", "dropped", "extrapolated", "blank"];
const FRAME_MEANING = { delivered: "handed to the sinks' queues" };
const WORD_TONE = { ok: "", LATE: "warn", INCOMPLETE: "bad", LOST: "bad", FAILED: "bad" };
const FRAME_TONE = { late: "warn", held: "warn", dropped: "bad", blank: "warn" };

// Fills a list with [name, value, tone, meaning]; without a value it is a heading.
function fillList(name, rows) {
  byId(name).replaceChildren(
    ...rows.flatMap(([title, value, tone, meaning]) => {
      const term = document.createElement("dt");
      term.textContent = title;
      term.title = meaning || title;
      if (value === undefined) {
        term.className = "group";
        return [term];
      }
      const number = document.createElement("dd");
      number.textContent = value;
      if (tone) number.className = tone;
      return [term, number];
    })
  );
}

const spaced = (name) => name.replaceAll("_", " ");

function showCounts(run) {
  const tone = (name) => (run.frames[name] > 0 ? FRAME_TONE[name] : "");
  const verdict = ["verdict so far", run.verdict, WORD_TONE[run.verdict], "first word of the verdict if the run ended now"];
  const frames = FRAME_COUNTS.map((name) => [name, run.frames[name], tone(name), FRAME_MEANING[name]]);
  fillList("counts", [verdict, ...frames]);
  const eventTone = (name) => (/lost|dropped|refused|overflow|busy/.test(name) ? "bad" : "");
  fillList("events", Object.entries(run.events).map(([name, n]) => [spaced(name), n, eventTone(name)]));
  const always = ["packets_received", "packets_sent"];
  // Other nodes of a shared bus do no harm.
  const plain = [...always, run.name_of_other_nodes];
  const ports = run.ports.flatMap((port, i) => [
    ...(run.ports.length > 1 ? [["port " + i]] : []),
    ...Object.entries(port.counters)
      .filter(([name, n]) => n > 0 || always.includes(name))
      .map(([name, n]) => [spaced(name), n, plain.includes(name) ? "" : "warn"]),
    ...Object.entries(port.rejects).map(([name, n]) => ["refused: " + name, n, "warn"]),
  ]);
  const more = run.ports_left_out > 0 ? [["ports not shown", run.ports_left_out, "warn"]] : [];
  fillList("bus", [...ports, ...more]);
}

function showFaults(frame) {
  const named = frame.faults.map((fault) => `${spaced(fault.name)} #${fault.number}: ${fault.value} ${fault.unit}`);
  const known = new Set(frame.faults.map((fault) => fault.name));
  const flags = frame.fault_flags.filter((flag) => !known.has(flag)).map(spaced);
  const more = frame.fault_count > frame.faults.length ? [`${frame.fault_count - frame.faults.length} more`] : [];
  const all = [...named, ...flags, ...more];
  const items = (all.length ? all : ["none"]).map((text) => {
    const item = document.createElement("li");
    item.textContent = text;
    if (!all.length) item.className = "none";
    return item;
  });
  byId("faults").replaceChildren(...items);
}
