// The pages of this view, one at a time; the address keeps which one.

const PAGES = ["view", "events", "timing"];

const chosenPage = () => PAGES.find((page) => !byId("page-" + page).hidden);

function choosePage(name) {
  for (const page of PAGES) {
    const is_chosen = page === name, tab = byId("tab-" + page);
    tab.setAttribute("aria-selected", String(is_chosen));
    tab.tabIndex = is_chosen ? 0 : -1;
    byId("page-" + page).hidden = !is_chosen;
  }
  if (name !== "view" || location.hash) history.replaceState(null, "", name === "view" ? "." : "#" + name);
  placeFrame();
  drawAll();
}

function followTabs() {
  PAGES.forEach((page, i) => {
    byId("tab-" + page).addEventListener("click", () => choosePage(page));
    byId("tab-" + page).addEventListener("keydown", ({ key }) => {
      const by = { ArrowRight: 1, ArrowLeft: -1 }[key];
      if (!by) return;
      const next = PAGES[(i + by + PAGES.length) % PAGES.length];
      choosePage(next);
      byId("tab-" + next).focus();
    });
  });
  const asked = location.hash.slice(1);
  if (PAGES.includes(asked)) choosePage(asked);
}
