/** A slider with its name, its value, which can be typed as well, and the way back; it shows the value that the server confirmed. */

import { el, icon, mark, show } from "./dom";
import { typedNumber } from "./format";

export interface SliderOptions {
  label: string;
  min: number;
  max: number;
  step: number;
  /** Unit, as shown behind the value and as read out. */
  unit: string;
  /** Default value, such as that with which its service has started; null while it is unknown. */
  initial(): number | null;
  /** Called while it is moved, at most one call at a time, and with what was typed; returns the value in use then, or null if it is refused. */
  send(value: number): Promise<number | null>;
  /** Called with the sentence on text that is no number. */
  onInvalid(problem: string): void;
}

export interface Slider {
  readonly element: HTMLElement;
  /** Value in use at the site, not shown while the slider is being moved; null: its service has gone. */
  set(value: number | null): void;
}

let sliders = 0;

export function slider({
  label,
  min,
  max,
  step,
  unit,
  initial,
  send: request,
  onInvalid,
}: SliderOptions): Slider {
  const id = `slider-${++sliders}`;
  const digits = (String(step).split(".")[1] ?? "").length;
  const input = el("input", { type: "range", id, min, max, step });
  const field = el("input", {
    type: "text",
    inputmode: "decimal",
    autocomplete: "off",
    "aria-label": `${label} in ${unit}`,
    value: "–",
  });
  const reset = el(
    "button",
    { type: "button", className: "quiet reset", hidden: true, onclick: () => void back() },
    icon("undo"),
  );
  let inUse: number | null = null;
  let isBusy = false;
  let wanted: number | null = null;
  let movedAt = -Infinity;
  /** Text that the field got from here or that was sent: another one is being typed. */
  let known = field.value;

  const text = (value: number): string => String(Number(value.toFixed(Math.max(digits, 2))));

  function fill(value: number): void {
    known = field.value = text(value);
  }

  function display(value: number): void {
    if (document.activeElement !== field || field.value === known) fill(value);
    mark(input, "aria-valuetext", `${text(value)} ${unit}`);
    offerReset(value);
  }

  function offerReset(value: number): void {
    const start = initial();
    const isInitial = start === null || text(value) === text(start);
    if (isInitial && document.activeElement === reset) input.focus();
    show(reset, !isInitial);
    if (start !== null) reset.title = `Back to ${text(start)} ${unit}`;
    mark(reset, "aria-label", `${label}: ${reset.title.toLowerCase()}`);
  }

  function settle(): void {
    if (inUse === null) return;
    if (inUse > Number(input.max)) input.max = String(inUse);
    if (inUse < Number(input.min)) input.min = String(inUse);
    if (Number(input.value) !== inUse) input.value = String(inUse);
    display(inUse);
  }

  async function send(value: number): Promise<void> {
    wanted = value;
    display(value);
    if (isBusy) return;
    isBusy = true;
    while (wanted !== null) {
      const next: number = wanted;
      wanted = null;
      const answered = await request(next);
      if (answered !== null) inUse = answered;
    }
    movedAt = performance.now();
    settle();
    isBusy = false;
  }

  async function back(): Promise<void> {
    const start = initial();
    if (start !== null) await send(start);
  }

  input.addEventListener("input", () => void send(Number(input.value)));
  field.addEventListener("focus", () => field.select());
  field.addEventListener("blur", () => {
    if (inUse !== null && !isBusy) fill(inUse);
  });
  field.addEventListener("change", () => {
    const value = typedNumber(field.value, unit);
    known = field.value;
    if (value !== null) return void send(value);
    onInvalid(
      `${label}: “${field.value.trim()}” is no number. Type one in ${unit}, such as ${text(inUse ?? min)}.`,
    );
    if (inUse !== null) fill(inUse);
  });
  return {
    element: el(
      "div",
      { className: "slider" },
      el("label", { for: id, text: label }),
      reset,
      el("span", { className: "typed" }, field, el("span", { text: unit })),
      input,
    ),
    set(value) {
      if (value === null) inUse = null;
      // the site's own state lags behind the answer a little
      if (isBusy || value === null || performance.now() - movedAt < 500) return;
      if (value === inUse) return offerReset(value);
      inUse = value;
      if (document.activeElement !== field) settle();
    },
  };
}
