/** Speaks the names of things, and has a live region that screen readers read. What is chosen is kept by this browser. */

import { write } from "./dom";

interface Choices {
  on: boolean | null;
  lang: string;
  rate: number;
}
/** Why nothing is heard: no voice at all, or of the language, or the browser does not speak. */
export type VoiceProblem = "" | "none" | "language" | "silent";

const STORED = "pointit-speaker";
/** Speeds of speech that are offered, as multiples of the usual one. */
export const RATES = [0.75, 1, 1.25, 1.5, 2];
/** Time in which a browser knows its voices, and begins to speak, ms. */
const PATIENCE_MS = 3000;

export class Speaker {
  private readonly choices: Choices = { on: null, lang: "", rate: 1 };
  private isUsual = false;
  /** Language unless the person chose another. */
  private usualLang = "";
  /** Called when what the fields show has changed. */
  onChange: () => void = () => {};
  private problem: VoiceProblem = "";
  /** Last step that was spoken. */
  private step = "";
  private waiting: ReturnType<typeof setTimeout> | undefined;

  /** `region`: element with `aria-live`. `report`: is told of names that were spoken, and why nothing is heard; returns whether it could pass that on. */
  constructor(
    private readonly region: HTMLElement,
    private readonly report: (spoken: number, problem: VoiceProblem) => boolean,
  ) {
    try {
      Object.assign(this.choices, JSON.parse(localStorage.getItem(STORED) ?? "{}"));
    } catch {
      // what is not ours counts as nothing
    }
    window.speechSynthesis?.addEventListener?.("voiceschanged", () => {
      this.onChange();
      if (this.problem !== "silent") this.tell(0, this.missing());
    });
  }

  get isOn(): boolean {
    return this.choices.on ?? this.isUsual;
  }

  /** Set whether and in which language names are spoken as long as the person has not chosen. */
  setUsual(speaks: boolean, lang: string): void {
    this.isUsual = speaks;
    this.usualLang = lang;
    this.onChange();
    if (speaks) setTimeout(() => this.tell(0, this.missing()), PATIENCE_MS);
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

  /** Speak a person's next step, once until another one was spoken. It waits for the end of a name, and a name cuts it off. */
  sayStep(step: string): void {
    if (!step || step === this.step) return;
    this.step = step;
    if (this.isOn) this.utter(step, false);
  }

  /** Language that the person has chosen, or "" for that of the page. */
  get chosenLanguage(): string {
    return this.choices.lang;
  }

  get rate(): number {
    return this.choices.rate;
  }

  /** Languages that the browser knows now, some of which it learns late; "" is that of the page. */
  get languages(): readonly string[] {
    const { lang } = this.choices;
    const known = new Set(lang ? [...this.voices, lang] : this.voices);
    return ["", ...[...known].sort()];
  }

  private get lang(): string {
    return this.choices.lang || this.usualLang;
  }

  private get voices(): readonly string[] {
    return (window.speechSynthesis?.getVoices() ?? []).map(({ lang }) => lang);
  }

  /** Keep what the person has chosen. */
  keep(change: Partial<Choices>): void {
    Object.assign(this.choices, change);
    try {
      localStorage.setItem(STORED, JSON.stringify(this.choices));
    } catch {
      // then it lasts as long as the page
    }
    this.onChange();
    this.tell(0, this.missing());
    this.unlock();
  }

  /** What the browser lacks. */
  private missing(): VoiceProblem {
    const { voices, lang } = this;
    const [main] = lang.toLowerCase().split("-");
    if (!this.isOn) return "";
    if (!voices.length) return "none";
    const hasLanguage = voices.some((each) => each.toLowerCase().split(/[-_]/)[0] === main);
    return lang && !hasLanguage ? "language" : "";
  }

  private tell(spoken: number, problem: VoiceProblem): void {
    if ((spoken || problem !== this.problem) && this.report(spoken, problem)) this.problem = problem;
  }

  /** `isName`: it cuts off what is being spoken, and is counted. */
  private utter(text: string, isName = true): void {
    const synthesis = window.speechSynthesis;
    const silent = (): void => this.tell(0, this.missing() || "silent");
    if (!synthesis) return silent();
    if (isName) synthesis.cancel();
    const utterance = new SpeechSynthesisUtterance(text);
    if (this.lang) utterance.lang = this.lang;
    utterance.rate = this.choices.rate;
    if (isName) clearTimeout(this.waiting);
    if (text && isName) {
      this.waiting = setTimeout(silent, PATIENCE_MS);
      utterance.onstart = () => {
        clearTimeout(this.waiting);
        this.tell(1, this.missing());
      };
      utterance.onerror = ({ error }) => {
        if (error !== "interrupted" && error !== "canceled") silent();
      };
    }
    synthesis.speak(utterance);
  }
}
