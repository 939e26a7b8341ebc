/** A value that a server confirms: what is being sent is shown until then. */

import { useReducer, useRef } from "preact/hooks";

/** The site's own state lags behind an answer a little, ms. */
const LAG_MS = 500;

interface Confirmed {
  /** Value to show; null while none is known. */
  readonly shown: number | null;
  /** Send one; at most one request at a time, and the last one wins. */
  put(value: number): Promise<void>;
}

/**
 * @param inUse the value of the site; null: its service has gone.
 * @param send returns the value in use then, or null if it is refused.
 */
export function useConfirmed(
  inUse: number | null,
  send: (value: number) => Promise<number | null>,
): Confirmed {
  const [, redraw] = useReducer((count: number) => count + 1, 0);
  const state = useRef({
    shown: null as number | null,
    confirmed: null as number | null,
    wanted: null as number | null,
    isBusy: false,
    answeredMs: -Infinity,
  }).current;
  if (!state.isBusy && inUse !== null && performance.now() - state.answeredMs >= LAG_MS) {
    state.shown = inUse;
    state.confirmed = inUse;
  }

  async function put(value: number): Promise<void> {
    state.wanted = value;
    state.shown = value;
    redraw(undefined);
    if (state.isBusy) return;
    state.isBusy = true;
    while (state.wanted !== null) {
      const next: number = state.wanted;
      state.wanted = null;
      state.confirmed = (await send(next)) ?? state.confirmed;
    }
    state.isBusy = false;
    state.shown = state.confirmed;
    state.answeredMs = performance.now();
    redraw(undefined);
  }

  return { shown: state.shown, put };
}
