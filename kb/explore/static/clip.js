// A film that the browser can't play is shown as a row of its frames.
"use strict";

const film = document.querySelector("video");
const row = document.querySelector("#frames");

function showFrames() {
  if (!row.hidden) return;
  const image = new Image();
  image.alt = "Frames of the clip, from its beginning to its end";
  image.src = row.dataset.frames;
  row.prepend(image);
  row.hidden = false;
  film.hidden = true;
}

film?.addEventListener("error", showFrames);
film?.addEventListener("loadedmetadata", () => film.videoWidth || showFrames());
if (film?.error) showFrames();
