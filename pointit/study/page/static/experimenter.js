import { join, made } from "./link.js";
import { draw } from "./top.js";

const at = (id) => document.getElementById(id);
const buttons = [...document.querySelectorAll("[data-command]")];
const WORDS = { text: "Reading", wait: "Getting ready", end: "The session has ended" };

function tell(text) {
  at("problem").textContent = text;
  at("problem").hidden = false;
}

const send = join(show, tell);

function put(id, text) {
  if (at(id).textContent !== text) at(id).textContent = text;
}

function show(content) {
  const { status, shown } = content;
  put("study", content.study);
  put("who", content.who);
  document.title = `${content.who}: ${content.study}`;
  put("state", status && shown.show === "wait" ? status.state : shown.show === "scale" ? `Answering ${shown.name}` : WORDS[shown.show]);
  if (status) {
    at("done").hidden = at("facts").hidden = false;
    at("attempts").hidden = !status.outcomes.length;
    put("trial", `${status.trial} of ${status.trials}`);
    put("left", String(status.left));
    put("condition", status.condition);
    put("quality", status.quality || "no estimate");
    at("done").max = status.trials;
    at("done").value = status.trials - status.left;
    at("outcomes").replaceChildren(...status.outcomes.map((each) => made("li", each)));
  }
  draw(at("top"), status?.live);
  put("target", status?.target || "none");
  put("pages", ["It is open nowhere.", "It is open once."][content.pages] ?? `It is open ${content.pages} times.`);
  const texts = shown.steps?.map((each) => each.text) ?? [shown.title, shown.text ?? ""];
  const lines = texts.flatMap((each) => each.split("\n"));
  at("shown").replaceChildren(...lines.filter(Boolean).map((each) => made("p", each)));
  for (const button of buttons) button.disabled = !content.can.includes(button.dataset.command);
  const isPaused = status?.state === "paused";
  const pause = buttons.find((each) => each.dataset.command === "pause");
  pause.textContent = isPaused ? "Go on" : "Pause";
}

for (const button of buttons.filter((each) => each.type === "button")) {
  button.onclick = () => {
    at("problem").hidden = true;
    send({ command: button.dataset.command });
  };
}

at("skip").onsubmit = (event) => {
  event.preventDefault();
  at("problem").hidden = true;
  const reason = at("reason").value.trim();
  if (!reason) {
    tell("Write why the trial is skipped.");
    at("reason").focus();
    return;
  }
  send({ command: "skip", reason });
  at("reason").value = "";
};
