// A key does what the button, link or field does that names it. An answer is sent at once, and the
// page shows what comes next without loading the clip of the same item again.
"use strict";

const waiting = [];
let sending = false;

const item = (page) => page.querySelector("#item")?.dataset.item;
const named = (key) => document.querySelector(`main [aria-keyshortcuts="${CSS.escape(key)}"]`);

function press(key) {
  if (sending) {
    waiting.push(key);
    return;
  }
  const target = named(key);
  if (target?.matches("input")) target.focus();
  else target?.click();
}

document.addEventListener("keydown", (event) => {
  if (event.target.matches("input, select, textarea")) {
    if (event.key === "Escape") event.target.blur();
    return;
  }
  const key = event.key.toLowerCase();
  if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || !named(key)) return;
  event.preventDefault();
  press(key);
});

function refuse(why) {
  waiting.length = 0;
  const note = document.querySelector("#problem");
  note.textContent = `Not saved: ${why}`;
  note.hidden = false;
}

function show(text) {
  const page = new DOMParser().parseFromString(text, "text/html");
  const focused = document.activeElement;
  const { name, value } = focused;
  if (!item(page) || item(page) !== item(document)) {
    waiting.length = 0; // what was typed was about the item before
    document.querySelector("main").replaceWith(page.querySelector("main"));
    document.querySelector("main").focus();
    return;
  }
  document.querySelector("#progress").innerHTML = page.querySelector("#progress").innerHTML;
  for (const id of ["undo", "questions", "free", "problem"]) {
    document.getElementById(id)?.replaceWith(page.getElementById(id));
  }
  if (name && !focused.isConnected) {
    const again = [...document.getElementsByName(name)];
    (again.find((one) => one.value === value) ?? again[0])?.focus();
  }
}

document.addEventListener("submit", async (event) => {
  const form = event.target;
  if (form.method !== "post") return;
  event.preventDefault();
  if (sending) return;
  sending = true;
  event.submitter?.setAttribute("aria-pressed", "true");
  try {
    const body = new URLSearchParams(new FormData(form, event.submitter));
    const answer = await fetch(form.action, { method: "POST", body });
    const text = await answer.text();
    if (answer.ok) {
      show(text);
      history.replaceState(null, "", answer.url);
    } else {
      const page = new DOMParser().parseFromString(text, "text/html");
      refuse(page.querySelector("[role=alert]")?.textContent ?? answer.statusText);
    }
  } catch {
    refuse("the server does not answer");
  }
  sending = false;
  if (waiting.length) press(waiting.shift());
});
