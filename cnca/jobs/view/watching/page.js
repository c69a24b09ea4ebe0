"use strict";

const find = (id) => document.getElementById(id);
const WIDTH = 400, HEIGHT = 100;
const PICTURES = {
  "before_after.png": "before and after, with the detector's boxes",
  "texture.png": "texture",
  "views_now.png": "the vehicle in its current paint, as the detector saw it",
  "texture_now.png": "the current texture",
};

function make(name, text = "", content = []) {
  const element = document.createElement(name);
  if (text) element.textContent = text;
  element.append(...content);
  return element;
}

function draw(name, curves, steps) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  const values = curves.flatMap((curve) => curve.values);
  const low = Math.min(0, ...values), high = Math.max(name === "score" ? 1 : low + 1e-6, ...values);
  svg.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
  svg.setAttribute("preserveAspectRatio", "none");
  svg.setAttribute("role", "img");
  const heard = curves.filter((curve) => curve.values.length).map((curve) =>
    `${curve.name}: ${curve.values[0].toFixed(2)} at first, ${curve.values.at(-1).toFixed(2)} now`);
  svg.setAttribute("aria-label", heard.join("; ") || `${name}: nothing yet`);
  curves.forEach((curve) => {
    const line = document.createElementNS(svg.namespaceURI, "polyline");
    line.setAttribute("class", curve.name === name ? "steps" : "checks");
    line.setAttribute("points", curve.values.map((value, i) =>
      `${curve.steps[i] / Math.max(steps, 1) * WIDTH},${HEIGHT - (value - low) / (high - low) * HEIGHT}`).join(" "));
    svg.append(line);
  });
  const key = make("p");
  key.className = "key";
  curves.filter((curve) => curve.values.length).forEach((curve) => {
    const part = make("span", `${curve.name === name ? "— steps" : "- - validation"} ${curve.values.at(-1).toFixed(3)}`);
    part.className = curve.name === name ? "steps" : "checks";
    key.append(part);
  });
  const range = make("span", `${low.toFixed(1)} to ${high.toFixed(1)}`);
  range.className = "quiet";
  key.append(range);
  return [make("h3", name === "score" ? "detection score" : "loss"), svg, key];
}

const minutes = (seconds) => seconds < 90 ? `${seconds.toFixed(0)} s` : `${(seconds / 60).toFixed(0)} min`;

function state(run) {
  if (run.rows.length) return "finished and judged";
  if (run.step >= run.steps && run.steps) return "judging on held-out views …";
  return run.seconds_left === null ? "beginning …" : `about ${minutes(run.seconds_left)} of steps to go`;
}

function article(run) {
  const progress = make("progress");
  progress.max = Math.max(run.steps, 1);
  progress.value = run.step;
  progress.setAttribute("aria-label", `steps of ${run.name}`);
  const where = make("p", `“${run.prompt}”, ${run.scene}`), now = make("p", `step ${run.step} of ${run.steps}: ${state(run)}`);
  where.className = "quiet";
  const parts = [make("h2", run.name), where, now, progress];
  for (const name of ["score", "loss"])
    parts.push(...draw(name, run.curves.filter((curve) => curve.name.startsWith(name)), run.steps));
  if (run.rows.length) {
    const head = make("thead", "", [make("tr", "", ["texture", "score", "AP@0.5"].map((text) => {
      const cell = make("th", text);
      cell.scope = "col";
      return cell;
    }))]);
    const body = make("tbody", "", run.rows.map((row) => make("tr", "", [
      make("td", row.meaning), make("td", row.score.toFixed(2)), make("td", row.average_precision.toFixed(2)),
    ])));
    parts.push(make("table", "", [head, body]));
  }
  for (const [name, meaning] of Object.entries(PICTURES)) {
    if (!run.pictures[name]) continue;
    const image = make("img");
    image.src = run.pictures[name];
    image.alt = `${run.name}: ${meaning}`;
    parts.push(make("figure", "", [image, make("figcaption", meaning)]));
  }
  return make("article", "", parts);
}

follow("watch", (news) => {
  find("note").textContent = "";
  find("runs").replaceChildren(...news.runs.map(article));
  document.body.dataset.number = news.number;
});
