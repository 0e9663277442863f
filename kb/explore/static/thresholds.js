// Moving the slider replaces the figures below it with those of its position.
"use strict";

const slider = document.querySelector("#slider input[type=range]");
let request = new AbortController();

async function show() {
  request.abort();
  request = new AbortController();
  const address = `/thresholds?${new URLSearchParams(new FormData(slider.form))}`;
  let text;
  try {
    const answer = await fetch(address, { signal: request.signal });
    if (!answer.ok) return;
    text = await answer.text();
  } catch {
    return; // a later position took its place, or the server has ended
  }
  const page = new DOMParser().parseFromString(text, "text/html");
  const open = document.querySelector("#result details")?.open;
  document.querySelector("#result").replaceWith(page.querySelector("#result"));
  const details = document.querySelector("#result details");
  if (details && open) details.open = true;
  document.querySelector("#exact input[name=value]").value =
    page.querySelector("#exact input[name=value]").value;
  slider.setAttribute(
    "aria-valuetext",
    page.querySelector("#slider input[type=range]").getAttribute("aria-valuetext"),
  );
  history.replaceState(null, "", address);
  offerCopies();
}

slider?.addEventListener("input", show);
