/** How far away a camera must be to show everything. */

import { cross, dot, unit, type Read3, type Vec3 } from "./vec";

/** From where to look at what. */
export interface Viewpoint {
  position: Vec3;
  target: Vec3;
}

/**
 * The nearest place from which all `points` are in sight, looking along `along` (unit).
 *
 * @param fov vertical, rad
 * @param aspect width by height of the picture
 * @param margin share of the picture left free about it
 */
export function framed(points: readonly Read3[], along: Read3, fov: number, aspect: number, margin = 0.08): Viewpoint {
  const right = unit(cross(along, [0, 0, 1]), [1, 0, 0]), up = cross(right, along);
  const tall = Math.tan(fov / 2) * (1 - margin), wide = tall * aspect;
  const seen = points.map((point) => [dot(point, right), dot(point, up), dot(point, along)] as const);
  // |x - center| <= wide * (z - from) for all: of each side the outermost bounds the place on its wedge's edge
  const wedge = (axis: 0 | 1, reach: number) => {
    let right = -Infinity, left = Infinity;
    for (const point of seen) {
      right = Math.max(right, point[axis] - reach * point[2]);
      left = Math.min(left, point[axis] + reach * point[2]);
    }
    return { center: (right + left) / 2, from: (left - right) / (2 * reach) };
  };
  const x = wedge(0, wide), y = wedge(1, tall);
  let nearest = Infinity, farthest = -Infinity;
  for (const point of seen) {
    nearest = Math.min(nearest, point[2]);
    farthest = Math.max(farthest, point[2]);
  }
  const from = Math.min(x.from, y.from, nearest - 0.5), to = Math.max((nearest + farthest) / 2, from + 0.5);
  const at = (depth: number): Vec3 =>
    [0, 1, 2].map((i) => right[i]! * x.center + up[i]! * y.center + along[i]! * depth) as Vec3;
  return { position: at(from), target: at(to) };
}
