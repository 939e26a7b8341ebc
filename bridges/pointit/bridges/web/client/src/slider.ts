/** A slider with its name and its value; it shows the value that the server confirmed. */

import { el, write } from "./dom";

export interface SliderOptions {
  label: string;
  min: number;
  max: number;
  step: number;
  /** As shown and as read out. */
  text(value: number): string;
  /** Called while it is moved, at most one call at a time; returns the value in use then, or nothing. */
  send(value: number): Promise<number | null>;
}

export interface Slider {
  readonly element: HTMLElement;
  /** Value in use at the site; not shown while the slider is being moved. */
  set(value: number | null): void;
}

let sliders = 0;

export function slider(options: SliderOptions): Slider {
  const id = `slider-${++sliders}`;
  const input = el("input", { type: "range", id, min: options.min, max: options.max, step: options.step });
  const output = el("output", { for: id, text: "–" });
  let inUse: number | null = null;
  let isBusy = false;
  let wanted: number | null = null;
  let movedAt = -Infinity;

  function display(value: number): void {
    const text = options.text(value);
    write(output, text);
    if (input.getAttribute("aria-valuetext") !== text) input.setAttribute("aria-valuetext", text);
  }

  function settle(): void {
    if (inUse === null) return;
    if (inUse > Number(input.max)) input.max = String(inUse);
    if (inUse < Number(input.min)) input.min = String(inUse);
    if (Number(input.value) !== inUse) input.value = String(inUse);
    display(inUse);
  }

  async function send(): Promise<void> {
    if (isBusy) return;
    isBusy = true;
    while (wanted !== null) {
      const value = wanted;
      wanted = null;
      const answered = await options.send(value);
      if (answered !== null) inUse = answered;
    }
    isBusy = false;
    movedAt = performance.now();
    settle();
  }

  input.addEventListener("input", () => {
    wanted = Number(input.value);
    display(wanted);
    void send();
  });
  return {
    element: el("div", { className: "slider" }, el("label", { for: id, text: options.label }), output, input),
    set(value) {
      // the site's own state lags behind the answer a little
      if (isBusy || value === null || performance.now() - movedAt < 500) return;
      if (value === inUse && output.textContent !== "–") return;
      inUse = value;
      settle();
    },
  };
}
