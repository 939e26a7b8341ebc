/** The phone's page as it is seen: before it starts, asking to point ahead, and as the person's button. */

import type { StepChoice } from "../wire";

/** What fills the screen. */
export type Stage = "before" | "centre" | "button" | "over";

const IDS = [
  "who",
  "link",
  "figures",
  "before",
  "start",
  "trouble",
  "running",
  "state",
  "next",
  "progress",
  "said",
  "choices",
  "big",
  "big-name",
  "big-note",
  "skip",
  "centre",
  "place",
  "listen",
  "let-go",
] as const;
type Id = (typeof IDS)[number];

export class Screen {
  private readonly parts: Record<Id, HTMLElement>;
  private readonly texts = new Map<Id, string>();
  private offered = "";
  private saidUntil: ReturnType<typeof setTimeout> | undefined;

  constructor() {
    this.parts = Object.fromEntries(
      IDS.map((id) => {
        const found = document.getElementById(id);
        if (!found) throw new Error(`phone.html lacks #${id}`);
        return [id, found];
      }),
    ) as Record<Id, HTMLElement>;
  }

  /** Call `done` when a button is tapped. */
  onTap(id: "start" | "skip" | "centre" | "place" | "listen" | "let-go", done: () => void): void {
    this.parts[id].addEventListener("click", done);
  }

  /** The big button itself, for touches. */
  get big(): HTMLButtonElement {
    return this.parts.big as HTMLButtonElement;
  }

  stage(stage: Stage): void {
    document.body.dataset.stage = stage;
    this.show("before", stage === "before" || stage === "over");
    this.show("start", stage === "before");
    this.show("running", stage === "centre" || stage === "button");
    this.show("skip", stage === "centre");
    for (const id of ["centre", "place", "let-go"] as const) this.show(id, stage === "button");
  }

  write(id: Id, text: string): void {
    if (this.texts.get(id) === text) return;
    this.texts.set(id, text);
    this.parts[id].textContent = text;
  }

  show(id: Id, isShown: boolean): void {
    this.parts[id].hidden = !isShown;
  }

  /** Mark what a style sheet shows: `data-…` of the page. */
  mark(name: "link" | "state", value: string): void {
    document.body.dataset[name] = value;
  }

  /** What to do next, and how far it has come, 0 to 1; null: that is not measured. */
  next(text: string, share: number | null): void {
    this.write("next", text);
    const progress = this.parts.progress as HTMLProgressElement;
    progress.hidden = share === null;
    progress.value = share ?? 0;
  }

  /** The choices of the next step, as buttons; the first one is the usual one. */
  offer(choices: readonly StepChoice[], choose: (id: string) => void): void {
    const shown = JSON.stringify(choices);
    if (this.offered === shown) return;
    this.offered = shown;
    const buttons = choices.map(({ id, label }) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = label;
      button.addEventListener("click", () => choose(id));
      return button;
    });
    this.parts.choices.replaceChildren(...buttons);
    this.show("choices", choices.length > 0);
  }

  /** Say something for as long as it takes to be read. */
  say(text: string): void {
    this.write("said", text);
    clearTimeout(this.saidUntil);
    if (text) this.saidUntil = setTimeout(() => this.write("said", ""), Math.max(6000, 100 * text.length));
  }

  /** Show a problem until it is replaced. */
  trouble(text: string): void {
    this.write("trouble", text);
    this.show("trouble", text !== "");
  }

  /** Enable the start button, and set its text. */
  offerStart(isOffered: boolean, name: string): void {
    (this.parts.start as HTMLButtonElement).disabled = !isOffered;
    this.write("start", name);
  }
}
