"use strict";

const { survey, pictures } = JSON.parse(document.getElementById("content").textContent);
const served = location.protocol.startsWith("http");
const memory = `cnca-survey-${survey}`;
const find = (id) => document.getElementById(id);
const [consent, rating, done] = ["consent", "rating", "done"].map(find);

function random(count) {
  return Array.from(crypto.getRandomValues(new Uint32Array(count)));
}

// A participant with an order of their own (Fisher and Yates; 2^32 makes its bias nothing).
function begin() {
  const order = pictures.map((picture) => picture.key);
  random(order.length).forEach((chance, i) => {
    const j = i + chance % (order.length - i);
    [order[i], order[j]] = [order[j], order[i]];
  });
  const participant = random(4).map((word) => word.toString(16).padStart(8, "0")).join("");
  return { participant, order, at: 0, answers: {}, revision: 0, sent: 0 };
}

let state = null;
try {
  state = JSON.parse(localStorage.getItem(memory));
} catch { /* a browser that remembers nothing: the page still works until it is closed */ }

function remember() {
  try {
    localStorage.setItem(memory, JSON.stringify(state));
  } catch { /* as above */ }
}

const sheet = () => JSON.stringify({
  survey, participant: state.participant, revision: state.revision, answers: state.answers,
});

// Sends all answers so far, one request after the other; whatever fails goes with the next one.
let sending = Promise.resolve();
function send() {
  if (served) sending = sending.then(post);
}
async function post() {
  const revision = state.revision;
  try {
    if (state.sent !== revision) {
      const answer = await fetch("answers", {
        method: "POST", body: sheet(), headers: { "Content-Type": "application/json" },
        signal: AbortSignal.timeout(15000),
      });
      if (!answer.ok) throw new Error(await answer.text());
      state.sent = revision;
      remember();
    }
    say(finished() ? "All your answers have been sent." : "");
  } catch (error) {
    say(`Your answers are kept in this browser, but could not be sent (${error.message}).`);
  }
}

function say(words) {
  find("state").textContent = words;
}

const finished = () => state.at === state.order.length;

function show() {
  consent.hidden = state !== null;
  rating.hidden = state === null || finished();
  done.hidden = state === null || !finished();
  if (!rating.hidden) {
    const key = state.order[state.at];
    find("picture").src = pictures.find((picture) => picture.key === key).src;
    find("picture").alt = `vehicle ${state.at + 1}, to be rated by how it looks`;
    find("number").textContent = state.at + 1;
    rating.querySelector("progress").value = state.at;
    find("back").disabled = state.at === 0;
    for (const choice of rating.elements.score) choice.checked = Number(choice.value) === state.answers[key];
  }
  if (!done.hidden) {
    const save = find("save");
    URL.revokeObjectURL(save.href);
    save.href = URL.createObjectURL(new Blob([sheet()], { type: "application/json" }));
    save.download = `answers-${state.participant.slice(0, 8)}.json`;
  }
}

function turn(steps) {
  state.at += steps;
  remember();
  show();
  (finished() ? done : rating).querySelector("h1").focus();
}

function choose(score) {
  state.answers[state.order[state.at]] = score;
  state.revision += 1;
  remember();
  send();
}

consent.addEventListener("submit", (event) => {
  event.preventDefault();
  state = begin();
  turn(0);
});
rating.addEventListener("submit", (event) => {
  event.preventDefault();
  turn(1);
  send();
});
rating.addEventListener("change", () => choose(Number(rating.elements.score.value)));
find("back").addEventListener("click", () => turn(-1));
find("revise").addEventListener("click", () => turn(-1));
find("send").addEventListener("click", () => {
  state.sent = -1;
  send();
});

addEventListener("keydown", (event) => {
  if (rating.hidden || event.ctrlKey || event.metaKey || event.altKey) return;
  if (/^[1-5]$/.test(event.key)) {
    const choice = rating.elements.score[event.key - 1];
    choice.checked = true;
    choice.focus();
    choose(Number(event.key));
  } else if (event.key === "Enter" && event.target.tagName !== "BUTTON") {
    event.preventDefault();
    rating.requestSubmit();
  }
});

document.body.classList.add(served ? "served-here" : "local-here");
show();
if (state) send();
