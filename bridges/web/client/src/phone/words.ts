/** Texts of the phone's page. */

import type { LinkState } from "./link";
import type { Source } from "./sensing";

/** Activity of the person by the interaction's state. */
const STATES: Readonly<Record<string, string>> = {
  idle: "Resting",
  localizing: "Finding your place",
  pointing: "Pointing",
};

export function stateWords(state: string): string {
  return STATES[state] ?? "";
}

/** Effect of the big button, by that of a press (`Interaction.press`); while staying selects, a press has none. */
export function pressWords(press: string): string {
  return (
    {
      "": "hold it to stop",
      start: "starts pointing",
      cancel: "calls it off",
      stop: "stops",
      confirm: "confirms; hold it to stop",
    }[press] ?? ""
  );
}

const LINKS: Readonly<Record<LinkState, string>> = {
  connecting: "Connecting …",
  open: "Connected",
  closed: "Stopped",
  unpaired: "This phone is no longer paired: scan a new QR code.",
  replaced: "The page was opened a second time on this phone; that one goes on.",
};

export function linkWords(state: LinkState): string {
  return LINKS[state];
}

/** The figures under the heading: `59/s · 12 ms · 84 %`. */
export function figures(
  rate: number,
  roundTrip: number | null,
  charge: number | null,
  source: Source | null,
  byPost: boolean,
): string {
  return [
    `${rate}/s`,
    roundTrip === null ? "" : `${Math.round(roundTrip)} ms`,
    charge === null ? "" : `battery ${Math.round(charge * 100)} %`,
    source === "event" ? "by events" : "",
    byPost ? "by posts" : "",
  ]
    .filter(Boolean)
    .join(" · ");
}
