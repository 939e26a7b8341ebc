/**
 * Appearance of objects, in the scene and in the plan alike: kinds and people each by a colour and, as colour is never
 * alone, a second sign; objects by a size, of which messages have the length only.
 */

import type { TrackedObject, UserProfile } from "../messages";
import type { Vec3 } from "./vec";

export type Rgb = readonly [number, number, number];
export type Pattern = UserProfile["pattern"];

/** Red, green, blue (0-255) by kind of object: `KIND_COLORS` of `schemas/environment.py`, as on the strips. */
export const KIND_COLORS: Readonly<Record<string, Rgb>> = {
  red: [255, 30, 0],
  green: [0, 158, 80],
  blue: [0, 80, 220],
  yellow: [240, 200, 20],
  orange: [230, 120, 0],
  purple: [190, 80, 170],
};
export const OTHER_COLOR: Rgb = [200, 200, 200];

/** Fences by their kind: where robots must stay, and where they may not go. As in Foxglove (`room.py`). */
export const FENCE_COLORS: Readonly<
  Record<"keep_in" | "keep_out", { readonly dark: string; readonly light: string }>
> = {
  keep_in: { dark: "#47d1a8", light: "#00664a" },
  keep_out: { dark: "#ff9088", light: "#b0211b" },
};

/** Floor from where things are not told apart: with its opacity it differs from the floor in lightness, too. */
export const INSEPARABLE_COLORS = { dark: "#e58ac9", light: "#8e2c78" } as const;

/** Width and height of a package, by its length: share, least and most, m. */
export const PACKAGE_WIDE = [0.75, 0.1, 0.34] as const;
export const PACKAGE_HIGH = [0.6, 0.1, 0.26] as const;
/** Width and height of a segment on a strip, m. */
export const SEGMENT = [0.07, 0.06] as const;
/** Length of an object without one, m: on a line, and elsewhere, as a robot. */
export const USUAL_LENGTH_M = 0.12;
export const ROBOT_M = 0.3;
/** A ray that meets nothing is drawn so far, m. */
export const FREE_RAY_M = 4;

type Sized = Pick<TrackedObject, "surface" | "length_m"> & { readonly size_m?: TrackedObject["size_m"] };

/** Whether `object` is drawn as the upright box that it fills, also where a part of a strip is its light. */
export function isBox({ surface, size_m }: Pick<Sized, "surface" | "size_m">): boolean {
  return Boolean(size_m) && surface !== "belt";
}

/** Length (along its belt or strip, or its own x axis), width and height of `object`, m. */
export function sizeOf(object: Sized): Vec3 {
  const { surface, length_m, size_m } = object;
  if (size_m && isBox(object)) return [...size_m];
  if (surface !== "belt" && surface !== "strip")
    return [length_m || ROBOT_M, length_m || ROBOT_M, length_m || ROBOT_M];
  const long = length_m || USUAL_LENGTH_M;
  if (surface === "strip") return [long, ...SEGMENT];
  return [
    long,
    ...(([PACKAGE_WIDE, PACKAGE_HIGH] as const).map(([share, least, most]) =>
      Math.min(Math.max(share * long, least), most),
    ) as [number, number]),
  ];
}

export function kindColor(kind: string): Rgb {
  return KIND_COLORS[kind] ?? OTHER_COLOR;
}

/** Brightness of an idle box, and the share of a person's colour when they begin to point at it, as on its light. */
const IDLE = 0.45;
const HOVERED = 0.3;

/** Colour of a box: its kind's, dim; the more that of who points at it, the nearer they are to selecting it; its owner's. */
export function boxColor(
  kind: string,
  owner: Rgb | null,
  hover: { readonly color: Rgb; readonly progress: number } | null,
): Rgb {
  if (owner) return owner;
  const idle = kindColor(kind).map((part) => IDLE * part);
  const share = hover ? HOVERED + (1 - HOVERED) * hover.progress : 0;
  return idle.map((part, i) => part + share * ((hover?.color[i] ?? 0) - part)) as [number, number, number];
}

/** The letter that stands on objects of a kind: its first, in capitals; kinds without a name have none. */
export function kindLetter(kind: string): string {
  return [...kind.trim()][0]?.toUpperCase() ?? "";
}

/** What is behind rays and rings: of the scene's floor and background the one that is nearer to their colours. */
export const GROUNDS: Readonly<Record<"dark" | "light", Rgb>> = {
  dark: [23, 29, 38],
  light: [228, 234, 241],
};
/** Of a person's colour and the ground. WCAG asks 3 of graphics; a ray is not quite opaque. */
const LEAST_CONTRAST = 4.5;
const STEP = 0.05;

/** `color` as it can be seen before the ground: brighter on a dark page, darker on a light one, where it must be. */
export function visibleColor(color: Rgb, dark: boolean): Rgb {
  const ground = GROUNDS[dark ? "dark" : "light"];
  const end = dark ? 255 : 0;
  let made = color;
  for (let share = STEP; share <= 1 && contrast(made, ground) < LEAST_CONTRAST; share += STEP) {
    made = color.map((part) => part + (end - part) * share) as [number, number, number];
  }
  return made;
}

/** What edges rays and rings, which lie on dark belts as well as on a light floor. */
export function casing(dark: boolean): Rgb {
  return dark ? [10, 14, 20] : [255, 255, 255];
}

/** `#rrggbb`. */
export function cssColor(color: Rgb): string {
  return `#${color.map((part) => Math.round(part).toString(16).padStart(2, "0")).join("")}`;
}

/** WCAG's relative luminance, 0 to 1. */
function luminance(color: Rgb): number {
  const [r, g, b] = color.map((part) =>
    part <= 10.31475 ? part / 3294.6 : ((part / 255 + 0.055) / 1.055) ** 2.4,
  ) as [number, number, number];
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

/** WCAG's contrast of two colours, 1 to 21. */
export function contrast(one: Rgb, other: Rgb): number {
  const [low, high] = [luminance(one), luminance(other)].sort((a, b) => a - b) as [number, number];
  return (high + 0.05) / (low + 0.05);
}

/** Black or white, whichever is read better upon `color`: its contrast is 4.5 at least, whatever the colour. */
export function inkOn(color: Rgb): "#000000" | "#ffffff" {
  return contrast(color, [0, 0, 0]) >= contrast(color, [255, 255, 255]) ? "#000000" : "#ffffff";
}

/** Where a ray that meets nothing is drawn to, {W}: the floor, or `FREE_RAY_M` far. */
export function rayEnd(origin: Readonly<Vec3>, direction: Readonly<Vec3>): Vec3 {
  const down = direction[2] < -1e-6 ? -origin[2] / direction[2] : Infinity;
  const reach = Math.min(Math.max(down, 0), FREE_RAY_M);
  return [
    origin[0] + reach * direction[0],
    origin[1] + reach * direction[1],
    origin[2] + reach * direction[2],
  ];
}
