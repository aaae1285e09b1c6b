"use strict";
/* Tables of class "sorts": a button in every head. Rows are sorted between the lines that head them, and stay among themselves. */
document.querySelectorAll("table.sorts").forEach((table) => {
  const heads = [...table.querySelectorAll("thead th")];

  function key(row, column) {
    const cell = row.cells[column];
    const large = [...(cell.querySelector("b") ?? cell).childNodes].filter((each) => each.nodeName !== "SMALL");
    const text = (cell.dataset.sort ?? large.map((each) => each.textContent).join("")).trim();
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

  function sort(column, way) {
    for (const body of table.tBodies) {
      let rows = [];
      const put = (before) => {
        rows.sort((one, other) => compare(key(one, column), key(other, column), way));
        rows.forEach((row) => body.insertBefore(row, before));
        rows = [];
      };
      for (const row of [...body.rows]) {
        if (row.cells.length === heads.length) rows.push(row);
        else put(row);
      }
      put(null);
    }
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
      // Names from A, numbers from the largest.
      const first = column === 0 ? 1 : -1;
      const way = fresh ? first : falling ? 1 : -1;
      head.setAttribute("aria-sort", way > 0 ? "ascending" : "descending");
      sort(column, way);
    });
  });
});
