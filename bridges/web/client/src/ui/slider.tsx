/** A slider with its name, its value, which can be typed as well, and the way back; it shows the value that the server confirmed. */

import { useLayoutEffect, useRef, useState } from "preact/hooks";
import { typedNumber } from "../format";
import { useConfirmed } from "./confirmed";
import { Icon } from "./elements";
import { useOwnId } from "./ids";

interface SliderProps {
  label: string;
  min: number;
  max: number;
  step: number;
  /** Unit, as shown behind the value and as read out. */
  unit: string;
  /** Default value, such as that with which its service has started; null while it is unknown. */
  initial: number | null;
  /** Value in use at the site; null: its service has gone. */
  value: number | null;
  /** Called while it is moved, at most one call at a time, and with what was typed; returns the value in use then, or null if it is refused. */
  send(value: number): Promise<number | null>;
  /** Called with the sentence on text that is no number. */
  onInvalid(problem: string): void;
}

export function Slider(props: SliderProps) {
  const { label, min, max, step, unit, initial, onInvalid } = props;
  const id = useOwnId("slider");
  const range = useRef<HTMLInputElement>(null);
  const reset = useRef<HTMLButtonElement>(null);
  const { shown, put } = useConfirmed(props.value, props.send);
  /** Text that is being typed, or null. */
  const [typed, setTyped] = useState<string | null>(null);
  const digits = Math.max((String(step).split(".")[1] ?? "").length, 2);
  const text = (value: number): string => String(Number(value.toFixed(digits)));
  const isInitial = shown === null || initial === null || text(shown) === text(initial);
  const back = initial === null ? "" : `Back to ${text(initial)} ${unit}`;

  useLayoutEffect(() => {
    if (isInitial && document.activeElement === reset.current) range.current?.focus();
  }, [isInitial]);

  function take(entered: string): void {
    const value = typedNumber(entered, unit);
    setTyped(null);
    if (value !== null) void put(value);
    else
      onInvalid(
        `${label}: “${entered.trim()}” is no number. Type one in ${unit}, such as ${text(shown ?? min)}.`,
      );
  }

  return (
    <div class="slider">
      <label for={id}>{label}</label>
      <button
        type="button"
        class="quiet reset"
        ref={reset}
        hidden={isInitial}
        title={back}
        aria-label={`${label}: ${back.toLowerCase()}`}
        onClick={() => void put(initial!)}
      >
        <Icon name="undo" />
      </button>
      <span class="typed">
        <input
          type="text"
          inputmode="decimal"
          autocomplete="off"
          aria-label={`${label} in ${unit}`}
          value={typed ?? (shown === null ? "–" : text(shown))}
          onFocus={({ currentTarget }) => currentTarget.select()}
          onInput={({ currentTarget }) => setTyped(currentTarget.value)}
          onChange={({ currentTarget }) => take(currentTarget.value)}
          onBlur={() => setTyped(null)}
        />
        <span>{unit}</span>
      </span>
      <input
        type="range"
        id={id}
        ref={range}
        min={Math.min(min, shown ?? min)}
        max={Math.max(max, shown ?? max)}
        step={step}
        value={shown ?? min}
        aria-valuetext={shown === null ? undefined : `${text(shown)} ${unit}`}
        onInput={({ currentTarget }) => void put(Number(currentTarget.value))}
      />
    </div>
  );
}
