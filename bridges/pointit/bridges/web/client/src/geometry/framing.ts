/** How far away a camera must be to show everything. */

import type { Bounds } from "./bounds";
import { cross, dot, scale, subtract, unit, type Read3, type Vec3 } from "./vec";

/** From where to look at what. */
export interface Viewpoint {
  position: Vec3;
  target: Vec3;
}

/**
 * The nearest place from which `bounds` is all in sight, looking along `along` (unit).
 *
 * @param fov vertical, rad
 * @param aspect width by height of the picture
 * @param margin share of the picture left free about it
 */
export function framed(bounds: Bounds, along: Read3, fov: number, aspect: number, margin = 0.08): Viewpoint {
  const { low, high } = bounds;
  const middle: Vec3 = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2];
  const right = unit(cross(along, [0, 0, 1]), [1, 0, 0]), up = cross(right, along);
  const tall = Math.tan(fov / 2) * (1 - margin), wide = tall * aspect;
  const corners = Array.from({ length: 8 }, (_, i): Vec3 => [
    (i & 1 ? high : low)[0], (i & 2 ? high : low)[1], (i & 4 ? high : low)[2],
  ]).map((corner) => {
    const from = subtract(corner, middle);
    return [dot(from, right), dot(from, up), dot(from, along)] as const;
  });
  // of a corner (x, y, z), |x - cx| <= wide * (z + far): both sides bound the centre, which is put in their midst
  const span = (axis: 0 | 1, reach: number) => {
    const most = Math.max(...corners.map((corner) => corner[axis] - reach * corner[2]));
    const least = Math.min(...corners.map((corner) => corner[axis] + reach * corner[2]));
    return { center: (most + least) / 2, far: (most - least) / (2 * reach) };
  };
  const x = span(0, wide), y = span(1, tall);
  const far = Math.max(x.far, y.far, 1 - Math.min(...corners.map((corner) => corner[2])));
  const target: Vec3 = [0, 1, 2].map((i) => middle[i]! + x.center * right[i]! + y.center * up[i]!) as Vec3;
  return { target, position: subtract(target, scale(along, far)) };
}
