/** Lanes of a timeline as shapes, and the events on them; pure. */

import type { TimelineLane } from "../wire";

/** Width and height of a lane's drawing, which is stretched to its place. */
export const WIDTH = 1000;
export const HEIGHT = 10;

export const LANE_NAMES: Record<TimelineLane["kind"], string> = {
  interaction: "State",
  robot: "Robot",
  hover: "Hover",
  selections: "Selected",
  refusals: "Refused",
  wrong: "Wrong",
  misses: "Missed",
  warnings: "Warnings",
};

type Item = TimelineLane["items"][number];

/** Outline of intervals, and of instants as lines without a width, for a path whose stroke is not stretched. */
export function outline(items: readonly Item[], length: number): string {
  const x = (at: number): string => ((at / Math.max(length, 1e-3)) * WIDTH).toFixed(2).replace(/\.?0+$/, "");
  return items
    .map(([start, end]) => `M${x(start)} 0V${HEIGHT}${end > start ? `H${x(end)}V0Z` : ""}`)
    .join("");
}

/** What a step to the next event stops at: selections, refusals, misses, warnings and changes of state, in order. */
export function events(lanes: readonly TimelineLane[]): { at: number; text: string }[] {
  const found = lanes
    .filter(({ kind }) => kind !== "hover")
    .flatMap(({ user, items }) =>
      items.map(([at, , text]) => ({ at, text: user ? `${user}: ${text}` : text })),
    );
  return found.sort((a, b) => a.at - b.at);
}

/** A position counts as that of an event that is so close, s. */
const SAME_S = 0.005;

/** The event after the position, or before it with `by` < 0; null: there is none. Those of one time are one. */
export function eventFrom(
  lanes: readonly TimelineLane[],
  at: number,
  by: number,
): { at: number; text: string } | null {
  const all = events(lanes);
  const next =
    by > 0 ? all.find((each) => each.at > at + SAME_S) : all.filter((each) => each.at < at - SAME_S).pop();
  if (!next) return null;
  const together = all.filter((each) => Math.abs(each.at - next.at) < SAME_S).map(({ text }) => text);
  return { at: next.at, text: together.join("; ") };
}

/** Text of the item at the position, or of the nearest one that is not further than `reach`; else "". */
export function textAt({ items }: TimelineLane, at: number, reach: number): string {
  let best = "";
  let least = reach;
  for (const [start, end, text] of items) {
    const off = at < start ? start - at : Math.max(0, at - end);
    if (off <= least) [best, least] = [text, off];
  }
  return best;
}

const STEPS_S = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400, 43200];

/** Round positions for the labels of the axis, s, `most` or fewer. */
export function ticks(length: number, most: number): number[] {
  const step = STEPS_S.find((each) => length / each < most) ?? Math.ceil(length / most);
  return Array.from({ length: Math.floor(length / step) + 1 }, (_, index) => index * step);
}

/** `1:07.3`, `1:02:07.3`. */
export function clock(seconds: number): string {
  const tenths = Math.round(Math.max(0, seconds) * 10);
  const s = Math.floor(tenths / 10);
  const hours = Math.floor(s / 3600);
  const minutes = Math.floor((s % 3600) / 60);
  const rest = `${String(s % 60).padStart(2, "0")}.${tenths % 10}`;
  return hours ? `${hours}:${String(minutes).padStart(2, "0")}:${rest}` : `${minutes}:${rest}`;
}

/** As read out: `1 min 7.3 s`. */
export function spoken(seconds: number): string {
  const minutes = Math.floor(seconds / 60);
  const rest = (seconds % 60).toFixed(1);
  return minutes ? `${minutes} min ${rest} s` : `${rest} s`;
}
