/** The keyboard: one table, which the help shows too. */

import type { Step } from "./messages";

type Text = string | (() => string);
/** The words of now. */
export const now = (text: Text): string => (typeof text === "string" ? text : text());

export interface Shortcut {
  /** As `KeyboardEvent.key` has it, letters small. */
  keys: readonly string[];
  /** As printed. */
  shown: Text;
  does: Text;
  /** Whether it is available now; others are not listed. */
  isOffered(): boolean;
  run(event: KeyboardEvent): void;
  /** Works though single keys are switched off. */
  isSafe?: boolean;
}

/** Where keys step to while names are announced. */
export const STEPS: Readonly<Record<string, readonly [by: -1 | 1, to: Step["to"]]>> = {
  ArrowLeft: [-1, "beside"],
  ArrowRight: [1, "beside"],
  ArrowUp: [-1, "row"],
  ArrowDown: [1, "row"],
  Home: [1, "here"],
};

const FIELDS = "input:not([type=checkbox]):not([type=radio]):not([type=range]), textarea, select";
/** What uses arrow keys itself. */
const MOVES = "input, select, textarea, [role=tab], .plan-list *, .log";

/**
 * Listen for shortcuts.
 * @param areOn single keys are wanted (they can be switched off, WCAG 2.1.4).
 */
export function listen(shortcuts: readonly Shortcut[], areOn: () => boolean): void {
  let isByKeyboard = false;
  addEventListener("pointerdown", () => (isByKeyboard = false), true);

  function found(event: KeyboardEvent): Shortcut | null {
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return null;
    const target = event.target instanceof Element ? event.target : document.body;
    const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const shortcut = shortcuts.find((each) => each.keys.includes(name) && each.isOffered());
    if (!shortcut || (!areOn() && !shortcut.isSafe)) return null;
    if (document.querySelector("dialog[open]")) return null;
    if (event.key === "Escape") return shortcut;
    if (target.matches(FIELDS)) return null;
    if ((event.key.startsWith("Arrow") || event.key === "Home") && target.matches(MOVES)) return null;
    // Space belongs to a control that the keyboard has come to; after a click it is the person's button
    if (event.key === " " && isByKeyboard && target.matches("button, input, summary, a, [role=tab]"))
      return null;
    return shortcut;
  }

  addEventListener("keydown", (event) => {
    if (
      event.key === "Tab" ||
      (event.key.startsWith("Arrow") && event.target instanceof Element && event.target.matches(MOVES))
    )
      isByKeyboard = true;
    const shortcut = found(event);
    if (!shortcut) return;
    event.preventDefault();
    if (event.repeat && !event.key.startsWith("Arrow")) return;
    shortcut.run(event);
  });
  // a clicked button would be clicked once more when Space is let go
  addEventListener("keyup", (event) => {
    if (event.key === " " && found(event)) event.preventDefault();
  });
}
