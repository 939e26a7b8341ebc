/** Polylines by arc length: strips and belts, as `pointit.geometry.polyline` has them. */

import { cross, norm, scale, subtract, unit, type Read3, type Vec3 } from "./vec";

/** Vertices closer together than this (m, on every axis) are one. */
const SAME_M = 1e-9;

/** A line through vertices, addressed by the distance from its start, m. */
export class Polyline {
  readonly vertices: readonly Read3[];
  /** Unit, one for each segment. */
  readonly tangents: readonly Read3[];
  /** Arc length at each vertex. */
  readonly starts: readonly number[];
  readonly length: number;

  /** @throws Error when the line has no length. */
  constructor(line: readonly Read3[]) {
    this.vertices = line.filter((vertex, i) => {
      const before = line[i - 1];
      return !before || vertex.some((x, axis) => Math.abs(x - before[axis]!) > SAME_M);
    });
    if (this.vertices.length < 2) throw new Error("a line needs two different vertices");
    const steps = this.vertices.slice(1).map((vertex, i) => subtract(vertex, this.vertices[i]!));
    const starts = [0];
    for (const step of steps) starts.push(starts.at(-1)! + norm(step));
    this.starts = starts;
    this.length = starts.at(-1)!;
    this.tangents = steps.map((step) => unit(step));
  }

  /** Index of the segment at arc length `at`, clamped to the ends. */
  segmentAt(at: number): number {
    let low = 0;
    let high = this.tangents.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.starts[middle]! <= at) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  /** The point at arc length `at`, clamped to the ends; with `beyond` the line goes straight on past them. */
  pointAt(at: number, beyond = false, out: Vec3 = [0, 0, 0]): Vec3 {
    const held = beyond ? at : Math.min(Math.max(at, 0), this.length);
    const segment = this.segmentAt(held);
    const from = this.vertices[segment]!;
    const along = this.tangents[segment]!;
    const rest = held - this.starts[segment]!;
    out[0] = from[0] + rest * along[0];
    out[1] = from[1] + rest * along[1];
    out[2] = from[2] + rest * along[2];
    return out;
  }

  /** Unit direction of travel at arc length `at`. */
  tangentAt(at: number): Read3 {
    return this.tangents[this.segmentAt(at)]!;
  }

  /** Azimuth (rad) of the chord of `length` m centred on `at`: the direction of an object of that length on the line. */
  headingAt(at: number, length = 0): number {
    const half = Math.max(length / 2, 1e-3);
    this.pointAt(at - half, true, FROM);
    this.pointAt(at + half, true, TO);
    return Math.atan2(TO[1] - FROM[1], TO[0] - FROM[0]);
  }

  /** Where, in the arc length, the place nearest to `point` lies, and how far `point` is from it, m. */
  nearestTo(point: Read3): { at: number; apart: number } {
    let at = 0;
    let apart = Infinity;
    this.tangents.forEach((along, i) => {
      const reach = subtract(point, this.vertices[i]!);
      const span = this.starts[i + 1]! - this.starts[i]!;
      const t = Math.min(Math.max(reach[0] * along[0] + reach[1] * along[1] + reach[2] * along[2], 0), span);
      const away = norm(subtract(reach, scale(along, t)));
      if (away < apart) [at, apart] = [this.starts[i]! + t, away];
    });
    return { at, apart };
  }
}

const FROM: Vec3 = [0, 0, 0];
const TO: Vec3 = [0, 0, 0];

/** To the left of `along` (unit), level; towards +y where `along` is upright. */
export function leftOf(along: Read3): Vec3 {
  return unit(cross([0, 0, 1], along), [0, 1, 0]);
}
