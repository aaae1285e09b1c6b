"use strict";
/* Tables of class "sorts": a button in every head. */
document.querySelectorAll("table.sorts").forEach((table) => {
  const heads = [...table.querySelectorAll("thead th")];

  function key(row, column) {
    const cell = row.cells[column];
    const text = (cell.dataset.sort ?? (cell.querySelector("b") ?? cell).textContent).trim();
    const found = /^[<>]?\s*([+\u2212-]?[\d.]+)\s*([kM]?)/.exec(text);
    if (!found) return text === "" || text === "\u2013" ? null : text.toLowerCase();
    return Number(found[1].replace("\u2212", "-")) * ({ k: 1e3, M: 1e6 }[found[2]] ?? 1);
  }

  /* Who has nothing to show comes last, whichever way. */
  function compare(one, other, way) {
    if (one === null || other === null) return (one === null) - (other === null);
    if (typeof one === typeof other) return way * (typeof one === "string" ? one.localeCompare(other) : one - other);
    return typeof one === "string" ? 1 : -1;
  }

  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const falling = head.getAttribute("aria-sort") === "descending";
      const fresh = !head.hasAttribute("aria-sort");
      heads.forEach((each) => each.removeAttribute("aria-sort"));
      const way = fresh ? (column === 0 ? 1 : -1) : falling ? 1 : -1; // names from A, numbers from the largest
      head.setAttribute("aria-sort", way > 0 ? "ascending" : "descending");
      const rows = [...table.tBodies[0].rows].sort((one, other) => compare(key(one, column), key(other, column), way));
      table.tBodies[0].append(...rows);
    });
  });
});
