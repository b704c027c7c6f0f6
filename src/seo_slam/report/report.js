"use strict";
(() => {
  const all = (selector, root = document) => [...root.querySelectorAll(selector)];
  const byId = (id) => document.getElementById(id);
  const numeric = new Set(["id", "position", "sigma", "size", "observations", "first"]);

  function sortTable(table, key, down) {
    const value = (row) => row.dataset[key];
    const order = numeric.has(key) ? (a, b) => (Number(value(a)) || 0) - (Number(value(b)) || 0) : (a, b) => value(a).localeCompare(value(b));
    const rows = all("tbody tr", table).sort((a, b) => (down ? -1 : 1) * order(a, b) || a.dataset.id - b.dataset.id);
    table.tBodies[0].append(...rows);
    for (const head of all("th[data-key]", table)) {
      if (head.dataset.key === key) head.setAttribute("aria-sort", down ? "descending" : "ascending");
      else head.removeAttribute("aria-sort");
    }
  }

  for (const table of all("table.landmarks")) {
    table.classList.add("sortable");
    for (const head of all("th[data-key]", table)) {
      head.tabIndex = 0;
      const sort = () => sortTable(table, head.dataset.key, head.getAttribute("aria-sort") === "ascending");
      head.addEventListener("click", sort);
      head.addEventListener("keydown", (event) => { if (event.key === "Enter") sort(); });
    }
  }

  function filterRows(text) {
    const wanted = text.trim().toLowerCase();
    for (const table of all("table.landmarks")) {
      let shown = 0;
      for (const row of all("tbody tr", table)) {
        row.hidden = wanted !== "" && !row.dataset.label.toLowerCase().includes(wanted) && row.dataset.id !== wanted.replace("#", "");
        shown += row.hidden ? 0 : 1;
      }
      table.nextElementSibling.hidden = shown > 0;
    }
  }

  function choose(id) {
    for (const node of all(".chosen")) node.classList.remove("chosen");
    for (const node of all(`.landmark[data-id="${id}"]`)) node.classList.add("chosen");
    const row = byId(`landmark-${id}`);
    if (!row) return;
    row.classList.add("chosen");
    const panel = byId("details");
    const text = document.createElement("div");
    const title = document.createElement("b");
    title.textContent = `${row.dataset.label || "unnamed"} #${id}${["tentative", "lost"].filter((state) => row.classList.contains(state)).map((state) => `, ${state}`).join("")}`;
    const list = document.createElement("dl");
    for (const cell of all("td[data-name]", row)) {
      if (["id", "label", "called"].includes(cell.dataset.name)) continue;
      const name = document.createElement("dt");
      const value = document.createElement("dd");
      name.textContent = cell.dataset.name;
      value.textContent = cell.textContent + (cell.dataset.name === "at" ? " m" : cell.dataset.name === "size" ? " cm" : "");
      list.append(name, value);
    }
    text.append(title, list);
    const more = document.createElement("a");
    more.className = "more";
    more.href = `#landmark-${id}`;
    more.textContent = "in the table";
    more.addEventListener("click", () => { const folded = row.closest("details"); if (folded) folded.open = true; });
    panel.replaceChildren(row.querySelector(".crop").cloneNode(true), text, more);
    panel.hidden = false;
  }

  for (const link of all(".map a[data-id]")) {
    link.addEventListener("click", (event) => { event.preventDefault(); choose(link.dataset.id); });
  }
  for (const link of all("a[data-show]")) link.addEventListener("click", () => choose(link.dataset.show));
  function openTarget() {
    const target = location.hash.length > 1 && byId(decodeURIComponent(location.hash.slice(1)));
    const folded = target && target.closest("details");
    if (folded && !folded.open) { folded.open = true; target.scrollIntoView(); }
  }
  addEventListener("hashchange", openTarget);
  openTarget();

  for (const controls of all(".controls")) controls.hidden = false;
  byId("filter")?.addEventListener("input", (event) => filterRows(event.target.value));
  byId("sort")?.addEventListener("change", (event) => {
    for (const table of all("table.landmarks")) sortTable(table, event.target.value, event.target.value === "observations");
  });
  const root = document.documentElement;
  const measure = () => {
    root.dataset.viewport = String(innerWidth);
    root.dataset.overflow = String(root.scrollWidth > innerWidth);
  };
  addEventListener("resize", measure);
  measure();
})();
