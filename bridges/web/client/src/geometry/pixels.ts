/** Where every pixel of the map's strips sits: as led-driver lays them out. */

import type { Strip } from "../messages";
import { Polyline } from "./polyline";
import type { Vec3 } from "./vec";

/** Arc length of pixel `number` (as numbered on the wire) of a strip that is `length` m long. */
export function pixelAt(number: number, strip: Pick<Strip, "pixels" | "direction">, length: number): number {
  const along = strip.direction === 1 ? number : strip.pixels - 1 - number;
  return ((along + 0.5) * length) / strip.pixels;
}

/** All pixels of a map one after the other, strip by strip in the map's order, pixel 0 of each first. */
export interface Pixels {
  readonly count: number;
  /** x, y, z in {W} of each. */
  readonly places: Float32Array;
  /** Azimuth of the strip at each, rad. */
  readonly headings: Float32Array;
  /** By strip: the number of its first pixel here, how many they are, how far apart, m. */
  readonly strips: ReadonlyMap<string, { first: number; pixels: number; pitch: number }>;
}

/** Lay `strips` out; strips without a length get no pixels. */
export function layOut(strips: readonly Strip[]): Pixels {
  const count = strips.reduce((sum, strip) => sum + strip.pixels, 0);
  const places = new Float32Array(3 * count);
  const headings = new Float32Array(count);
  const found = new Map<string, { first: number; pixels: number; pitch: number }>();
  const at: Vec3 = [0, 0, 0];
  let first = 0;
  for (const strip of strips) {
    let line;
    try {
      line = new Polyline(strip.line_m);
    } catch {
      continue;
    }
    for (let i = 0; i < strip.pixels; i++) {
      const position = pixelAt(i, strip, line.length);
      places.set(line.pointAt(position, false, at), 3 * (first + i));
      headings[first + i] = line.headingAt(position);
    }
    found.set(strip.id, { first, pixels: strip.pixels, pitch: line.length / strip.pixels });
    first += strip.pixels;
  }
  return {
    count: first,
    places: places.subarray(0, 3 * first),
    headings: headings.subarray(0, first),
    strips: found,
  };
}
