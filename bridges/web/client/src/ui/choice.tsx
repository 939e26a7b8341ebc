/** One of a few: radio buttons that look like one control. */

import { useRef } from "preact/hooks";
import { columnsOf, HOLD_MS, type Option } from "../choice";
import { Icon } from "./elements";
import { useOwnId } from "./ids";

interface ChoiceProps {
  legend: string;
  options: readonly Option[];
  /** The option in use; none of them: nothing is. */
  value: string;
  onChoose(value: string): void;
  /** The legend is read out only. */
  isBare?: boolean;
}

export function Choice({ legend, options, value, onChoose, isBare = false }: ChoiceProps) {
  const group = useOwnId("choice");
  /** A new choice is shown for a while, before the value in use replaces it. */
  const held = useRef({ value: "", untilMs: -Infinity });
  const shown = performance.now() < held.current.untilMs ? held.current.value : value;

  function choose(chosen: string): void {
    held.current = { value: chosen, untilMs: performance.now() + HOLD_MS };
    onChoose(chosen);
  }

  return (
    <fieldset class={isBare ? "plain bare" : "plain"}>
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
