/** One of a few: radio buttons that look like one control. */

import { el, icon, write } from "./dom";

export interface Option {
  value: string;
  label: string;
  icon?: string;
  /** CSS colour of a swatch beside the label. */
  swatch?: string;
}

export interface Choice {
  readonly element: HTMLFieldSetElement;
  /** Set the options; keeps the elements if they are unchanged. */
  offer(options: readonly Option[]): void;
  /** Show which is in use; none of them: nothing is. */
  set(value: string): void;
  enable(isEnabled: boolean): void;
}

let groups = 0;
/** Time (ms) for which a new choice is shown before the value in use replaces it. */
export const HOLD_MS = 1500;

/** Characters of a label that four columns have room for, three, or two; an icon or a swatch takes as much as three. */
const ROOM = [
  [6, 4],
  [10, 3],
  [17, 2],
] as const;

/** Number of columns with which the rows are as even as can be: two and two rather than three and one. */
export function columnsOf(options: readonly Option[]): number {
  const longest = Math.max(
    ...options.map(({ label, icon: symbol, swatch }) => label.length + (symbol || swatch ? 3 : 0)),
  );
  const most = ROOM.find(([room]) => longest <= room)?.[1] ?? 1;
  return Math.ceil(options.length / Math.ceil(options.length / most)) || 1;
}

export function choice(
  legend: string,
  onChoose: (value: string) => void,
  options: readonly Option[] = [],
): Choice {
  const group = `choice-${++groups}`;
  const row = el("div", { className: "choice" });
  const element = el("fieldset", { className: "plain" }, el("legend", { text: legend }), row);
  let offered = "";
  let current = "";
  let heldUntil = -Infinity;
  function check(): void {
    for (const input of row.querySelectorAll("input")) {
      if (input.checked !== (input.value === current)) input.checked = input.value === current;
    }
  }

  const self: Choice = {
    element,
    offer(next) {
      const signature = JSON.stringify(next);
      if (signature === offered) return;
      const isFocused = row.contains(document.activeElement);
      offered = signature;
      row.style.setProperty("--columns", String(columnsOf(next)));
      row.replaceChildren(
        ...next.map((option) => {
          const input = el("input", {
            type: "radio",
            name: group,
            value: option.value,
            onchange: () => {
              current = option.value;
              heldUntil = performance.now() + HOLD_MS;
              onChoose(option.value);
            },
          });
          const name = el("span", {});
          write(name, option.label);
          const swatch = option.swatch ? el("i", { className: "swatch" }) : null;
          if (swatch) swatch.style.background = option.swatch!;
          return el(
            "label",
            {},
            input,
            el("span", { className: "face" }, option.icon ? icon(option.icon) : swatch, name),
          );
        }),
      );
      check();
      if (isFocused) row.querySelector<HTMLInputElement>("input:checked, input")?.focus();
    },
    set(value) {
      if (performance.now() < heldUntil) return;
      current = value;
      check();
    },
    enable(isEnabled) {
      if (element.disabled === isEnabled) element.disabled = !isEnabled;
    },
  };
  self.offer(options);
  return self;
}
