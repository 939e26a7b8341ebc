/** A belt's surface: both its edges along the centre line, joined cleanly in curves. */

import { leftOf, type Polyline } from "./polyline";
import { add, dot, scale, unit, type Read3, type Vec3 } from "./vec";

/** One cut across a belt; between cuts the surface is ruled. */
export interface Cut {
  /** Arc length on the centre line, m. */
  readonly at: number;
  readonly center: Read3;
  readonly left: Read3;
  readonly right: Read3;
}

/** A mitre no longer than this many half widths: sharper corners are cut off. */
const LONGEST_MITRE = 2;

/** Cuts across the ribbon `width` m wide about `line`: one at each vertex, so edges run parallel to the line. */
export function ribbon(line: Polyline, width: number): Cut[] {
  const last = line.tangents.length - 1;
  return line.vertices.map((center, i) => {
    const before = leftOf(line.tangents[Math.max(i - 1, 0)]!);
    const after = leftOf(line.tangents[Math.min(i, last)]!);
    const across = unit(add(before, after), before);
    const half = (width / 2) * Math.min(1 / Math.max(dot(across, before), 1e-6), LONGEST_MITRE);
    return {
      at: line.starts[i]!,
      center,
      left: add(center, scale(across, half)),
      right: add(center, scale(across, -half)),
    };
  });
}

/** The outline of the ribbon as a closed polygon seen from above: along the left edge, back along the right. */
export function outline(cuts: readonly Cut[]): Vec3[] {
  const there = cuts.map((cut): Vec3 => [...cut.left]);
  const back = cuts.map((cut): Vec3 => [...cut.right]);
  return [...there, ...back.reverse()];
}
