/** What the chosen person says: the microphone, what was understood, and the answer to an open question. */

import type { Controls } from "../controls";
import { el, icon, mark, show, write } from "../dom";
import { capital } from "../format";
import { Voice, type SaidWord } from "../voice";
import type { PanelPart } from "./panel_part";

/** Without a sentence that was understood, it is said after so long, ms, that there was none. */
const PATIENCE_MS = 4000;
const NOBODY = "No command in that, or nobody follows: pointit listen";

export function speechPart(controls: Controls): PanelPart {
  const { site } = controls;
  let waiting = "";
  let waitsUntil = 0;
  let before: unknown = null;
  const heard = el("p", { className: "muted", role: "status" });
  const result = el("p", { role: "status", className: "understood" });
  const voice = new Voice({
    hearing: (text) => write(heard, `… ${text}`),
    said: (words) => void say(words),
    turned: (isOn, problem) => {
      mark(button, "aria-pressed", String(isOn));
      write(
        heard,
        problem || (isOn ? `Say what ${controls.user} means: take that, put that there, stop.` : ""),
      );
    },
  });
  const button = el(
    "button",
    {
      type: "button",
      "aria-pressed": "false",
      title: "The browser recognises the words; some send the voice to their maker",
      onclick: () => voice.toggle(),
    },
    icon("microphone"),
    el("span", { text: "Listen" }),
  );
  const answer = (text: string): HTMLButtonElement =>
    el("button", {
      type: "button",
      text: capital(text),
      onclick: () => void say([{ text, start_s: 0.3, end_s: 0, confidence: 1 }]),
    });
  const answers = el("div", { className: "pairs", hidden: true }, answer("yes"), answer("no"));
  const element = el(
    "section",
    { className: "part", "aria-label": "Speech" },
    button,
    heard,
    result,
    answers,
  );

  async function say(words: SaidWord[]): Promise<void> {
    waiting = words.map(({ text }) => text).join(" ");
    before = controls.person?.understood ?? null;
    waitsUntil = performance.now() + PATIENCE_MS;
    write(heard, `“${waiting}”`);
    await controls.ask({ deed: "speak", name: controls.user, query: { words } });
  }

  return {
    element,
    update() {
      const may = controls.mayDo("speak") && controls.user !== "";
      const understood = controls.person?.understood ?? null;
      if (!may) voice.stop();
      show(element, (may && voice.isThere) || understood !== null);
      show(button, may && voice.isThere);
      if (understood !== before) waiting = "";
      if (waiting && performance.now() > waitsUntil && understood?.result !== "asked") {
        write(heard, `“${waiting}”: ${NOBODY} ${controls.user}`);
        waiting = "";
      }
      write(result, understood ? `“${understood.text}”: ${understood.message || understood.result}` : "");
      mark(result, "data-result", understood?.result ?? null);
      show(answers, may && understood?.result === "asked" && site.connected);
    },
  };
}
