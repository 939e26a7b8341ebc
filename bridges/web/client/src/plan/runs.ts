/** Pixels of a strip as a few paths: neighbours of one colour are drawn at a stroke. */

import type { Strip } from "../messages";
import type { Polyline } from "../geometry/polyline";
import { xy } from "./svg";

/** Number of distinct levels of each colour; finer ones would make a path for every pixel of a gradient. */
const STEP = 16;

/** The `n + 1` edges of a strip's pixels as `x y` of the plan, pixel 0 first. */
export function edges(strip: Strip, line: Polyline): string[] {
  return Array.from({ length: strip.pixels + 1 }, (_, i) => {
    const share = i / strip.pixels;
    return xy(line.pointAt(line.length * (strip.direction === 1 ? share : 1 - share)));
  });
}

/** By colour (`#rrggbb`) the path through its pixels; pixels that are off are in none. */
export function paths(rgb: Uint8Array, at: readonly string[]): Map<string, string> {
  const found = new Map<string, string>();
  const pixels = Math.min(Math.floor(rgb.length / 3), at.length - 1);
  let from = 0;
  for (let i = 1; i <= pixels; i++) {
    if (i < pixels && level(rgb, i) === level(rgb, from)) continue;
    const key = level(rgb, from);
    if (key) {
      const colour = `#${key.toString(16).padStart(6, "0")}`;
      found.set(colour, `${found.get(colour) ?? ""}M${at.slice(from, i + 1).join("L")}`);
    }
    from = i;
  }
  return found;
}

/** The pixel's colour in one number, quantised; 0: off. */
function level(rgb: Uint8Array, pixel: number): number {
  const [r, g, b] = [rgb[3 * pixel]!, rgb[3 * pixel + 1]!, rgb[3 * pixel + 2]!];
  if (r + g + b === 0) return 0;
  return (round(r) << 16) | (round(g) << 8) | round(b) || 0x111111;
}

function round(value: number): number {
  return Math.min(255, Math.round(value / STEP) * STEP);
}
