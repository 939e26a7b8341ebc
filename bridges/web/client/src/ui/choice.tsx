/** One of a few: radio buttons that look like one control. */

import { useRef } from "preact/hooks";
import { columnsOf, type Option } from "./columns";
import { Icon } from "./elements";
import { useOwnId } from "./ids";

/** Time for which a new choice is shown before the value in use replaces it, ms. */
const HOLD_MS = 1500;

interface ChoiceProps {
  legend: string;
  options: readonly Option[];
  /** The option in use; none of them: nothing is. */
  value: string;
  onChoose(value: string): void;
  /** The legend is read out only. */
  isBare?: boolean;
  class?: string;
}

export function Choice({ legend, options, value, onChoose, isBare = false, class: look = "" }: ChoiceProps) {
  const group = useOwnId("choice");
  const held = useRef({ value: "", untilMs: -Infinity });
  const shown = performance.now() < held.current.untilMs ? held.current.value : value;

  function choose(chosen: string): void {
    held.current = { value: chosen, untilMs: performance.now() + HOLD_MS };
    onChoose(chosen);
  }

  return (
    <fieldset class={["plain", isBare ? "bare" : "", look].filter(Boolean).join(" ")}>
      <legend>{legend}</legend>
      <div class="choice" style={{ "--columns": columnsOf(options) }}>
        {options.map((option) => (
          <label key={option.value}>
            <input
              type="radio"
              name={group}
              value={option.value}
              checked={option.value === shown}
              onChange={() => choose(option.value)}
            />
            <span class="face">
              {option.icon && <Icon name={option.icon} />}
              {option.swatch && <i class="swatch" style={{ background: option.swatch }} />}
              <span>{option.label}</span>
            </span>
          </label>
        ))}
      </div>
    </fieldset>
  );
}
