import { join, made } from "./link.js";

const main = document.getElementById("content");
const problem = document.getElementById("problem");
const MOST_BUTTONS = 11; // a scale of more steps is a slider
let shown = ""; // what the page was built from
let built = ""; // its kind, or the number of its question

function tell(text) {
  problem.textContent = text;
  problem.hidden = false;
}

const send = join(show, tell);

function show(content) {
  const now = JSON.stringify(content);
  if (now === shown) return; // connected again: what is half answered stays
  shown = now;
  const key = content.id ? `question ${content.id}` : `${content.show} ${content.title}`;
  if (key === built) return update(content);
  built = key;
  problem.hidden = true;
  const parts = { text, scale, wait, end: wait }[content.show](content);
  main.replaceChildren(...parts);
  scrollTo(0, 0);
  main.querySelector("h1").focus();
}

function update(content) {
  const small = document.getElementById("small");
  if (!small) return;
  small.textContent = content.text;
  document.getElementById("place").textContent = place(content);
}

function place(content) {
  return content.trials && content.show !== "end" ? `Trial ${content.trial} of ${content.trials}` : "";
}

function wait(content) {
  return [
    made("h1", content.title, { tabindex: -1 }),
    made("p", content.text, { id: "small", class: "lead" }),
    made("p", place(content), { id: "place", class: "quiet" }),
  ];
}

function paragraphs(content) {
  return content.steps.flatMap((step) => [
    ...step.text.split("\n").filter((each) => each.trim()).map((each) => made("p", each)),
    ...(step.image === null ? [] : [made("img", "", { src: `image/${step.image}`, alt: step.alt })]),
  ]);
}

function text(content) {
  const isConsent = content.go === "agree";
  const heading = made("h1", isConsent ? "Consent" : "Instruction", { tabindex: -1 });
  const go = made("button", isConsent ? "Next" : "Begin", { type: "button", class: "primary" });
  if (!isConsent) {
    go.onclick = () => send({ id: content.id });
    return [heading, ...paragraphs(content), go];
  }
  const tick = made("input", "", { type: "checkbox", id: "tick" });
  const label = made("label", "", { class: "tick" }, tick, made("span", "I have read this, and I agree."));
  const no = made("button", "I do not agree", { type: "button" });
  go.onclick = () => {
    if (tick.checked) return send({ id: content.id, agrees: true });
    tell("Tick that you agree, or press I do not agree.");
    tick.focus();
  };
  no.onclick = () => send({ id: content.id, agrees: false });
  return [heading, ...paragraphs(content), label, made("div", "", { class: "row" }, go, no)];
}

function scale(content) {
  const [low, high] = content.points;
  const values = [];
  for (let value = low; value <= high; value += content.step) values.push(value);
  const items = content.items.map((item, index) => {
    const ends = [made("span", content.ends[0]), made("span", content.ends[1])];
    const group = made("fieldset", "", {}, made("legend", item));
    group.append(values.length > MOST_BUTTONS ? slider(values, content.step, item) : buttons(values, index, content.ends));
    group.append(made("div", "", { class: "ends", "aria-hidden": "true" }, ...ends));
    return group;
  });
  const next = made("button", "Next", { type: "submit", class: "primary" });
  const form = made("form", "", { novalidate: "" }, ...items, next);
  form.oninput = form.onclick = (event) => {
    const group = event.target.closest("fieldset");
    if (!group || valueOf(group) === null) return;
    group.classList.remove("open");
    problem.hidden = true;
  };
  form.onsubmit = (event) => {
    event.preventDefault();
    const answers = items.map(valueOf);
    const open = answers.filter((each) => each === null).length;
    if (open === 0) return send({ id: content.id, answers });
    items.forEach((each, index) => each.classList.toggle("open", answers[index] === null));
    tell(open === 1 ? "One answer is missing." : `${open} answers are missing.`);
    const first = items[answers.indexOf(null)];
    first.scrollIntoView({ block: "center" });
    first.querySelector("input").focus();
  };
  return [made("h1", content.title, { tabindex: -1 }), ...(content.text ? [made("p", content.text, { class: "quiet" })] : []), form];
}

function valueOf(group) {
  const found = group.querySelector("input:checked, input[data-answered]");
  return found ? Number(found.value) : null;
}

function buttons(values, index, ends) {
  const row = made("div", "", { class: "steps" });
  values.forEach((value, at) => {
    const input = made("input", "", { type: "radio", name: `item${index}`, value });
    const end = at === 0 ? `, ${ends[0]}` : at === values.length - 1 ? `, ${ends[1]}` : "";
    if (end) input.setAttribute("aria-label", `${value}${end}`);
    row.append(made("label", "", {}, input, made("span", String(value))));
  });
  return row;
}

// It has no answer until it is moved or tapped, or confirmed by the space bar: its first place suggests none.
function slider(values, step, item) {
  const input = made("input", "", {
    type: "range", min: values[0], max: values.at(-1), step, value: values[(values.length - 1) >> 1], "aria-label": item,
    "aria-valuetext": "not answered",
  });
  const answered = () => {
    input.dataset.answered = "1";
    input.setAttribute("aria-valuetext", input.value);
  };
  input.addEventListener("input", answered);
  input.addEventListener("click", answered);
  input.addEventListener("keydown", (event) => {
    if (event.key !== " ") return;
    event.preventDefault();
    answered();
  });
  return input;
}
