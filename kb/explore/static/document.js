// A text and its boxes on the screenshot light up together; the screenshot shows the place asked for.
"use strict";

const shot = document.querySelector(".page");

function light(event) {
  const on = event.type === "mouseover" || event.type === "focusin";
  const number = event.target.closest("[data-block]")?.dataset.block;
  if (number === undefined) return;
  for (const one of document.querySelectorAll(`[data-block="${number}"]`)) {
    one.classList.toggle("lit", on);
    if (!on) continue;
    const inShot = one.closest(".page");
    if (inShot && !event.target.closest(".page")) reveal(one);
  }
}

function reveal(one) {
  const at = one.getBoundingClientRect(), around = shot.getBoundingClientRect();
  if (at.top < around.top || at.bottom > around.bottom) {
    shot.scrollTop += at.top - around.top - 40;
  }
}

for (const kind of ["mouseover", "mouseout", "focusin", "focusout"]) {
  document.addEventListener(kind, light);
}
shot?.addEventListener("click", (event) => {
  const number = event.target.closest("[data-block]")?.dataset.block;
  document.querySelector(`.part [data-block="${number}"]`)?.scrollIntoView({ block: "center" });
});
const box = shot?.querySelector("g.here rect");
if (box) shot.scrollTop += box.getBoundingClientRect().top - shot.getBoundingClientRect().top - 40;
