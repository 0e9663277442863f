// P and N turn pages; J and K go to the next and the previous pair or answer.
"use strict";

document.addEventListener("keydown", (event) => {
  const typing = event.target.matches("input, select, textarea");
  if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
  const key = event.key.toLowerCase();
  if (key === "n" || key === "p") {
    document.querySelector(`a[rel=${key === "n" ? "next" : "prev"}]`)?.click();
  } else if (key === "j" || key === "k") {
    const links = [...document.querySelectorAll("article h2 a")];
    const at = links.indexOf(document.activeElement);
    links[at + (key === "j" ? 1 : -1)]?.focus();
  }
});
