/** How kinds and people are told apart: each by a colour and, as colour is never alone, a second sign. */

import type { UserProfile } from "../messages";

export type Rgb = readonly [number, number, number];
export type Pattern = UserProfile["pattern"];

/** Red, green, blue (0-255) by kind of object, as led-driver shows them unless it is told otherwise. */
export const KIND_COLORS: Readonly<Record<string, Rgb>> = {
  red: [255, 30, 0], green: [0, 158, 80], blue: [0, 80, 220],
  yellow: [240, 200, 20], orange: [230, 120, 0], purple: [190, 80, 170],
};
const OTHER: Rgb = [200, 200, 200];

export function kindColor(kind: string): Rgb {
  return KIND_COLORS[kind] ?? OTHER;
}

/** The letter that stands on objects of a kind: its first, in capitals; kinds without a name have none. */
export function kindLetter(kind: string): string {
  return [...kind.trim()][0]?.toUpperCase() ?? "";
}

/** `color` as it can be seen before the page's background: darker on a light page where it is too bright. */
export function visibleColor(color: Rgb, dark: boolean): Rgb {
  if (dark || 0.299 * color[0] + 0.587 * color[1] + 0.114 * color[2] < 170) return color;
  return [color[0] * 0.62, color[1] * 0.62, color[2] * 0.62];
}

/** `#rrggbb`. */
export function cssColor(color: Rgb): string {
  return `#${color.map((part) => Math.round(part).toString(16).padStart(2, "0")).join("")}`;
}
