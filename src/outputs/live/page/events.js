// The page of events: the newest ones with their times, and how often each kind happened.

// Fills the body of a table: rows of cells [text, class]; a cell carries its column's title for narrow screens.
function fillTable(name, rows) {
  const table = byId(name);
  const titles = [...table.querySelectorAll("thead th")].map((title) => title.textContent);
  table.tBodies[0].replaceChildren(
    ...rows.map((cells) => {
      const row = document.createElement("tr");
      row.setAttribute("role", "row");
      row.append(
        ...cells.map(([content, tone], i) => {
          const cell = document.createElement("td");
          cell.setAttribute("role", "cell");
          cell.dataset.title = titles[i];
          if (tone) cell.className = tone;
          if (content === "–") cell.classList.add("empty");
          cell.append(content);
          return cell;
        })
      );
      return row;
    })
  );
}

function showEvents(run) {
  const newest = run.newest_events;
  fillTable("newest", newest.map((event) => [
    [event.utc.slice(11, 23), ""],
    [spaced(event.kind), "name"],
    [spaced(event.what) || "–", ""],
    [event.frame === null ? "–" : String(event.frame), ""],
    [shortSpan(event.span_ms), ""],
  ]));
  const counts = Object.entries(run.events).sort((a, b) => b[1] - a[1]);
  const all = counts.reduce((sum, [, n]) => sum + n, 0);
  fillList("kinds", counts.map(([name, n]) => [spaced(name), n]));
  byId("newest-facts").textContent = newest.length ? `${newest.length} of ${all}` : "none yet";
  byId("kinds-facts").textContent = all ? `${all} in all` : "none yet";
}

const shortSpan = (ms) => (ms < 0 ? "−" + shortMs(-ms) : shortMs(ms));
