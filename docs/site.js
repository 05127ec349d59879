"use strict";
// What scrolls can be scrolled by keyboard; the theme wraps wide tables when the page is there.
addEventListener("load", () =>
  requestAnimationFrame(() => {
    for (const wrap of document.querySelectorAll(".md-typeset__scrollwrap")) {
      if (wrap.scrollWidth > wrap.clientWidth) wrap.tabIndex = 0;
    }
  }),
);

// A choice above each column of the table of claims that has few values: only rows with it are shown.
const table = document.querySelector(".claims table");
if (table) {
  const heads = [...table.tHead.rows[0].cells].map((cell) => cell.textContent.trim());
  const rows = [...table.tBodies[0].rows];
  for (const row of rows)
    [...row.cells].forEach((cell, i) => {
      cell.dataset.head = heads[i];
    });
  const count = document.createElement("output");
  const choices = ["paper", "verdict"].map((head) => {
    const column = heads.indexOf(head);
    const select = document.createElement("select");
    for (const value of ["all", ...new Set(rows.map((row) => row.cells[column].textContent.trim()))])
      select.add(new Option(value));
    return { column, select, label: Object.assign(document.createElement("label"), { textContent: `${head} ` }) };
  });
  const show = () => {
    for (const row of rows)
      row.hidden = !choices.every(({ column, select }) =>
        [row.cells[column].textContent.trim(), "all"].includes(select.value),
      );
    count.textContent = `${rows.filter((row) => !row.hidden).length} of ${rows.length} claims`;
  };
  const bar = Object.assign(document.createElement("p"), { className: "narrow" });
  for (const { label, select } of choices) {
    label.append(select);
    select.addEventListener("change", show);
    bar.append(label, " ");
  }
  bar.append(count);
  document.querySelector(".claims").prepend(bar);
  show();
}
