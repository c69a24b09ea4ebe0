"use strict";

// Drag across a frame: report the pointer's place in it, 0 at the left edge, 1 at the right.
function drag(frame, moved) {
  const place = (event) => {
    const box = frame.getBoundingClientRect();
    moved(Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)));
  };
  frame.addEventListener("pointerdown", (event) => {
    frame.setPointerCapture(event.pointerId);
    place(event);
  });
  frame.addEventListener("pointermove", (event) => {
    if (frame.hasPointerCapture(event.pointerId)) place(event);
  });
}

// A range input and the frame above it, which both say where we are.
function steer(figure, show) {
  const at = figure.querySelector(".at");
  drag(figure.querySelector(".frame"), (share) => {
    at.value = Math.round(share * at.max);
    show(at.value);
  });
  at.addEventListener("input", () => show(at.value));
}

for (const slider of document.querySelectorAll(".slider")) {
  const frame = slider.querySelector(".frame");
  const [before, after] = slider.querySelectorAll("figcaption span");
  const view = slider.querySelector(".view");
  const strip = slider.querySelector(".strip");
  steer(slider, (percent) => frame.style.setProperty("--at", `${percent}%`));
  const choose = () => {
    for (const picture of frame.querySelectorAll("img")) {
      const left = picture.classList.contains("left");
      picture.hidden = picture.dataset.view !== view.value
        || !left && picture.dataset.strip !== strip.value;
      if (!picture.hidden) (left ? before : after).textContent = picture.dataset.caption;
    }
  };
  view.addEventListener("change", choose);
  strip.addEventListener("change", choose);
  choose(); // a reloaded page keeps what was chosen
}

for (const turntable of document.querySelectorAll(".turntable")) {
  const frames = turntable.querySelectorAll("img");
  steer(turntable, (shown) => frames.forEach((frame, i) => { frame.hidden = i !== Number(shown); }));
}

addEventListener("beforeprint", () => {
  for (const details of document.querySelectorAll("details")) details.open = true;
});
