"use strict";

const content = JSON.parse(document.getElementById("content").textContent);
const find = (id) => document.getElementById(id);
const fields = [...document.querySelectorAll("[data-key]")];
const frame = find("frame");
let controls = null;
let dragging = false;

// ---------------- between a slider's way and what it means ----------------
const LEAST_VISIBILITY = 5, LEAST_ERROR = 0.005, MOST_ERROR = 0.4;
const logarithmic = (least, most) => ({
  value: (way) => least * (most / least) ** (way / 100),
  way: (value) => 100 * Math.log(value / least) / Math.log(most / least),
});
const fog = logarithmic(LEAST_VISIBILITY, content.clearest);
const target = logarithmic(MOST_ERROR, LEAST_ERROR);
const percent = (share) => `${(100 * share).toFixed(share < 0.1 ? 1 : 0)} %`;
const degrees = (value) => `${value.toFixed(0)}°`;
const time = (ms) => ms < 1000 ? `${ms.toFixed(0)} ms` : `${(ms / 1000).toFixed(ms < 1e4 ? 1 : 0)} s`;
const clock = (hour) => `${Math.floor(hour)}:${String(Math.floor(hour % 1 * 60)).padStart(2, "0")}`;

// At an end of these two there is none: clear air, and the usual models.
const SCALES = {
  visibility: { value: (way) => way >= 100 ? null : fog.value(way), way: (v) => v === null ? 100 : fog.way(v),
    text: (v) => v === null ? "clear air" : `${v.toPrecision(2) * 1} m` },
  target_error: { value: (way) => way <= 0 ? null : target.value(way), way: (v) => v === null ? 0 : target.way(v),
    text: (v) => v === null ? "the usual models" : percent(v) },
  sun_altitude: { text: degrees },
  sun_azimuth: { text: degrees },
  wetness: { text: percent },
  hour: { text: clock },
};

const valueOf = (field) => {
  const scale = SCALES[field.dataset.key];
  if (field.type === "text") return field.value.trim();
  return scale && scale.value ? scale.value(Number(field.value)) : Number(field.value);
};

function say(field, value) {
  const output = field.parentElement.querySelector(".value");
  const scale = SCALES[field.dataset.key];
  if (output && scale && value !== undefined) output.textContent = scale.text(value);
}

function settle() {
  for (const field of fields) {
    const value = controls[field.dataset.key], scale = SCALES[field.dataset.key];
    if (value === undefined) continue;
    if (field !== document.activeElement || field.type === "range" && !pending)
      field.value = scale && scale.way ? scale.way(value) : value;
    say(field, value);
  }
}

// ---------------- what is asked for: one request at a time, the newest values ----------------
let pending = null, sending = false;

async function post(path, body) {
  const response = await fetch(path, {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
  });
  const answer = await response.json();
  if (answer.error) throw new Error(answer.error);
  return answer;
}

async function ask(update) {
  pending = { ...pending, ...update };
  if (sending) return;
  sending = true;
  while (pending) {
    const now = pending;
    pending = null;
    try {
      controls = { ...await post("/controls", now), ...(dragging ? camera() : {}) };
      settle();
    } catch (error) { find("note").textContent = error.message; }
  }
  sending = false;
}

for (const field of fields) {
  field.addEventListener(field.type === "range" ? "input" : "change", () => {
    if (field.type === "number" && !field.checkValidity()) return;
    const value = valueOf(field);
    say(field, value);
    ask({ [field.dataset.key]: value });
  });
}
find("controls").addEventListener("submit", (event) => event.preventDefault());

for (const what of ["picture", "scene"]) {
  find(`save-${what}`).addEventListener("click", async () => {
    try {
      find("saved").textContent = (await post("/save", { what })).saved;
    } catch (error) { find("saved").textContent = error.message; }
  });
}

// ---------------- the camera ----------------
const camera = () => ({ azimuth: controls.azimuth, elevation: controls.elevation, distance: controls.distance });
const within = (value, least, most) => Math.min(Math.max(value, least), most);
let last = null, rest = 0;

function turn(right, up, away, moving) {
  if (!controls) return;
  controls.azimuth = ((controls.azimuth + right) % 360 + 360) % 360;
  controls.elevation = within(controls.elevation + up, 1, 89);
  controls.distance = within(controls.distance * away, 3, 200);
  ask({ ...camera(), moving });
}

// A wheel and keys do not say when they have ended.
function nudge(right, up, away) {
  turn(right, up, away, true);
  clearTimeout(rest);
  rest = setTimeout(() => ask({ moving: false }), 250);
}

frame.addEventListener("pointerdown", (event) => {
  frame.setPointerCapture(event.pointerId);
  last = [event.clientX, event.clientY];
  dragging = true;
  frame.classList.add("dragging");
});
frame.addEventListener("pointermove", (event) => {
  if (!dragging) return;
  const [x, y] = last;
  last = [event.clientX, event.clientY];
  turn((x - event.clientX) * 0.4, (event.clientY - y) * 0.25, 1, true);
});
for (const name of ["pointerup", "pointercancel"]) {
  frame.addEventListener(name, () => {
    if (!dragging) return;
    dragging = false;
    frame.classList.remove("dragging");
    ask({ moving: false });
  });
}
frame.addEventListener("wheel", (event) => {
  event.preventDefault();
  nudge(0, 0, Math.exp(within(event.deltaY, -100, 100) * 0.001));
}, { passive: false });
const KEYS = {
  ArrowLeft: [-5, 0, 1], ArrowRight: [5, 0, 1], ArrowUp: [0, 3, 1], ArrowDown: [0, -3, 1],
  "+": [0, 0, 0.9], "-": [0, 0, 1.1],
};
frame.addEventListener("keydown", (event) => {
  if (!KEYS[event.key]) return;
  event.preventDefault();
  nudge(...KEYS[event.key]);
});

// ---------------- what is shown ----------------
const shownAt = [];

function drawBoxes(boxes) {
  find("boxes").replaceChildren(...boxes.map((box) => {
    const outline = document.createElement("div"), label = document.createElement("span");
    outline.style.left = `${100 * box.left}%`;
    outline.style.top = `${100 * box.top}%`;
    outline.style.width = `${100 * (box.right - box.left)}%`;
    outline.style.height = `${100 * (box.bottom - box.top)}%`;
    outline.classList.toggle("at-top", box.top < 0.06);
    label.textContent = `${box.label} ${box.score.toFixed(2)}`;
    outline.append(label);
    return outline;
  }));
}

function rows(body, table, chosen = () => false, bars = []) {
  body.replaceChildren(...table.map((cells, i) => {
    const row = document.createElement("tr");
    row.classList.toggle("chosen", chosen(i));
    cells.forEach((text) => { row.insertCell().textContent = text; });
    if (bars.length) {
      row.lastElementChild.className = "bar";
      row.lastElementChild.style.setProperty("--share", `${100 * bars[i]}%`);
    }
    return row;
  }));
}

function drawCosts(plan, targets) {
  rows(find("plan"), plan.map((row) => [
    row.effect, String(row.model), row.error ? percent(row.error) : "–",
    row.milliseconds ? row.milliseconds.toFixed(row.milliseconds < 10 ? 1 : 0) : "–", row.why,
  ]), (i) => i === plan.length - 1);
  const most = Math.log(Math.max(...targets.map((row) => row.milliseconds)) + 1);
  const error = controls.target_error;
  const nearest = error === null ? -1 : targets.reduce((best, row, i) =>
    Math.abs(Math.log(row.target / error)) < Math.abs(Math.log(targets[best].target / error)) ? i : best, 0);
  rows(find("targets"), targets.map((row) => [
    `${percent(row.target)}${row.error > row.target ? " (not reached)" : ""}`, String(row.samples), time(row.milliseconds),
  ]), (i) => i === nearest, targets.map((row) => Math.log(row.milliseconds + 1) / most));
}

function show(news) {
  if (!controls || !dragging && !sending && !pending) {
    controls = news.controls;
    settle();
  }
  find("note").textContent = news.note;
  if (!news.picture) return;
  find("picture").src = news.picture;
  drawBoxes(news.boxes);
  drawCosts(news.plan, news.targets);
  const now = performance.now();
  shownAt.push(now);
  while (now - shownAt[0] > 2000) shownAt.shift();
  find("rays").max = news.planned;
  find("rays").value = news.samples;
  const rate = shownAt.length > 1 ? (shownAt.length - 1) / (now - shownAt[0]) * 1000 : 0;
  find("spent").textContent = news.controls.moving
    ? `moving: ${rate.toFixed(1)} pictures a second`
    : `${news.samples} of ${news.planned} rays per pixel in ${time(news.milliseconds)}`;
  document.body.dataset.number = news.number;
  document.body.dataset.samples = news.samples;
}

follow("view", show);
