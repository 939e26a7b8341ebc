/** Lights in a camera's frame: what differs from the frame in the dark, and how it moves from frame to frame. */

import type { Colour } from "./code";

/** A spot of light. */
export interface Blob {
  /** Centre, image pixels, right and down from the outer corner of the first pixel. */
  u: number;
  v: number;
  /** Number of image pixels. */
  area: number;
  colour: Colour;
}

export interface Place {
  u: number;
  v: number;
}

/** Bytes red, green, blue, alpha of each image pixel. */
export type Pixels = Uint8Array | Uint8ClampedArray;

/** More spots than this are no lights of ours: a screen, a window, a picture that moves. */
const MOST = 4000;
const LEAST_AREA = 2;
const LEAST_THRESHOLD = 14;
const MOST_THRESHOLD = 90;

/** The difference of a channel, 0 to 255, that noise of two frames of the same light does not reach. */
export function thresholdOf(one: Pixels, other: Pixels): number {
  const counts = new Uint32Array(256);
  let total = 0;
  for (let i = 0; i < one.length; i += 28) {
    for (let c = 0; c < 3; c++) counts[Math.abs(one[i + c]! - other[i + c]!)]!++;
    total += 3;
  }
  let level = 255;
  for (let above = 0; level > 0; level--) if ((above += counts[level]!) > total / 500) break;
  return Math.min(MOST_THRESHOLD, Math.max(LEAST_THRESHOLD, 1.8 * level + 4));
}

/** Return the spots of `frame` that are brighter than `dark` by `threshold` in a channel; null: too many. */
export function blobsOf(
  frame: Pixels,
  dark: Pixels,
  width: number,
  height: number,
  threshold: number,
): Blob[] | null {
  const size = width * height;
  const rise = new Uint8Array(size);
  for (let p = 0, i = 0; p < size; p++, i += 4) {
    const most = Math.max(frame[i]! - dark[i]!, frame[i + 1]! - dark[i + 1]!, frame[i + 2]! - dark[i + 2]!);
    if (most > threshold) rise[p] = most;
  }
  const found: Blob[] = [];
  const stack: number[] = [];
  for (let begin = 0; begin < size; begin++) {
    if (!rise[begin]) continue;
    stack.push(begin);
    let [area, weight, u, v] = [0, 0, 0, 0];
    const sums = [0, 0, 0];
    const levels = [rise[begin]!];
    rise[begin] = 0;
    while (stack.length) {
      const p = stack.pop()!;
      const level = levels.pop()!;
      const x = p % width;
      const y = (p - x) / width;
      area++;
      weight += level;
      u += level * (x + 0.5);
      v += level * (y + 0.5);
      for (let c = 0; c < 3; c++) sums[c]! += Math.max(0, frame[4 * p + c]! - dark[4 * p + c]!);
      for (let dy = -1; dy <= 1; dy++) {
        if (y + dy < 0 || y + dy >= height) continue;
        for (let dx = -1; dx <= 1; dx++) {
          const q = p + dy * width + dx;
          if (x + dx < 0 || x + dx >= width || !rise[q]) continue;
          stack.push(q);
          levels.push(rise[q]!);
          rise[q] = 0;
        }
      }
    }
    if (area < LEAST_AREA) continue;
    if (found.length >= MOST) return null;
    found.push({ u: u / weight, v: v / weight, area, colour: sums.indexOf(Math.max(...sums)) as Colour });
  }
  return found;
}

/**
 * Return for each of `places` the blob that it has become, null if it is gone or two of them are one now.
 *
 * All move together, by a hand's tremor: by `shift` last time, which is updated, and at most `reach` more.
 */
export function followed(
  places: readonly Place[],
  blobs: readonly Blob[],
  shift: Place,
  reach: number,
): (Blob | null)[] {
  const grid = new Grid(blobs, reach);
  for (const radius of [reach, reach / 2]) {
    const du: number[] = [];
    const dv: number[] = [];
    for (const place of places) {
      const near = grid.nearest(place.u + shift.u, place.v + shift.v, radius);
      if (!near) continue;
      du.push(near.u - place.u);
      dv.push(near.v - place.v);
    }
    if (du.length) [shift.u, shift.v] = [median(du), median(dv)];
  }
  const taken = new Map<Blob, number>();
  const now = places.map(({ u, v }) => grid.nearest(u + shift.u, v + shift.v, reach / 2));
  for (const blob of now) if (blob) taken.set(blob, (taken.get(blob) ?? 0) + 1);
  return now.map((blob) => (blob && taken.get(blob) === 1 ? blob : null));
}

export function median(values: readonly number[]): number {
  const sorted = [...values].sort((a, b) => a - b);
  return sorted[sorted.length >> 1] ?? 0;
}

/** Blobs by cells of the image. */
class Grid {
  private readonly cells = new Map<string, Blob[]>();

  constructor(
    blobs: readonly Blob[],
    private readonly size: number,
  ) {
    for (const blob of blobs) {
      const name = this.cell(blob.u, blob.v);
      const there = this.cells.get(name);
      if (there) there.push(blob);
      else this.cells.set(name, [blob]);
    }
  }

  /** `radius`: at most the cells' size. */
  nearest(u: number, v: number, radius: number): Blob | null {
    let best: Blob | null = null;
    let least = radius;
    for (const dx of [-1, 0, 1]) {
      for (const dy of [-1, 0, 1]) {
        for (const blob of this.cells.get(this.cell(u + dx * this.size, v + dy * this.size)) ?? []) {
          const apart = Math.hypot(blob.u - u, blob.v - v);
          if (apart < least) [best, least] = [blob, apart];
        }
      }
    }
    return best;
  }

  private cell(u: number, v: number): string {
    return `${Math.floor(u / this.size)} ${Math.floor(v / this.size)}`;
  }
}
