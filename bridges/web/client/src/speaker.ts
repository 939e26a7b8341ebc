/** Speaks the names of things, and has a live region that screen readers read. What is chosen is kept by this browser. */

import { el, write } from "./dom";

interface Choices { on: boolean | null; lang: string; rate: number }

const STORED = "pointit-speaker";
const RATES = [0.75, 1, 1.25, 1.5, 2];

export class Speaker {
  private readonly choices: Choices = { on: null, lang: "", rate: 1 };
  private isUsual = false;
  private box: HTMLInputElement | null = null;

  /** `region`: element with `aria-live`. */
  constructor(private readonly region: HTMLElement) {
    try {
      Object.assign(this.choices, JSON.parse(localStorage.getItem(STORED) ?? "{}"));
    } catch {
      // what is not ours counts as nothing
    }
  }

  get isOn(): boolean { return this.choices.on ?? this.isUsual; }

  /** Set whether names are spoken as long as the person has not chosen. */
  setUsual(speaks: boolean): void {
    this.isUsual = speaks;
    if (this.box) this.box.checked = this.isOn;
  }

  /** Within a tap: phones speak nothing before a first utterance that a tap caused. */
  unlock(): void {
    if (this.isOn) this.utter("");
  }

  /** Speak a name; it cuts off the one before. */
  say(name: string): void {
    // the same text twice is a change only with another ending
    write(this.region, this.region.textContent === name ? `${name}\u00a0` : name);
    if (this.isOn) this.utter(name);
  }

  /** Fields to choose whether, in which language and how fast. */
  fields(): HTMLElement {
    const { choices } = this, voices = window.speechSynthesis?.getVoices() ?? [];
    const languages = [...new Set(voices.map(({ lang }) => lang))].sort();
    const keep = (): void => {
      choices.lang = lang.value;
      choices.rate = Number(rate.value);
      try {
        localStorage.setItem(STORED, JSON.stringify(choices));
      } catch {
        // then it lasts as long as the page
      }
      this.unlock();
    };
    const option = (value: string, text: string, chosen: string) => el("option", { value, text, selected: value === chosen });
    const on = this.box = el("input", { type: "checkbox", onchange: () => {
      choices.on = on.checked;
      keep();
    } });
    on.checked = this.isOn;
    const lang = el("select", { onchange: keep }, option("", "as the page", choices.lang), ...languages.map((each) => option(each, each, choices.lang)));
    const rate = el("select", { onchange: keep }, ...RATES.map((each) => option(String(each), `${each} ×`, String(choices.rate))));
    return el("div", { className: "speaker" },
      el("label", { className: "check" }, on, el("span", { text: "Speak the names of things I point at" })),
      el("label", {}, "Language ", lang), el("label", {}, "Rate ", rate));
  }

  private utter(text: string): void {
    const synthesis = window.speechSynthesis;
    if (!synthesis) return;
    synthesis.cancel();
    const utterance = new SpeechSynthesisUtterance(text);
    if (this.choices.lang) utterance.lang = this.choices.lang;
    utterance.rate = this.choices.rate;
    synthesis.speak(utterance);
  }
}
