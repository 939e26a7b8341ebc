/** Fields of the phone's page to choose whether, in which language and how fast names are spoken. */

import { el } from "../dom";
import { RATES, type Speaker } from "../speaker";

/** Make the fields. They follow the speaker: browsers know their voices late. */
export function speakerFields(speaker: Speaker): HTMLElement {
  const box = el("input", { type: "checkbox", onchange: () => speaker.keep({ on: box.checked }) });
  const language = el("select", { onchange: () => speaker.keep({ lang: language.value }) });
  const rate = el("select", { onchange: () => speaker.keep({ rate: Number(rate.value) }) });
  rate.append(...RATES.map((each) => el("option", { value: String(each), text: `${each} ×` })));

  function fill(): void {
    box.checked = speaker.isOn;
    language.replaceChildren(
      ...speaker.languages.map((each) => el("option", { value: each, text: each || "as the page" })),
    );
    language.value = speaker.chosenLanguage;
    rate.value = String(speaker.rate);
  }

  speaker.onChange = fill;
  fill();
  return el(
    "div",
    { className: "speaker" },
    el("label", { className: "check" }, box, el("span", { text: "Speak the names of things I point at" })),
    el("label", {}, "Language ", language),
    el("label", {}, "Rate ", rate),
  );
}
