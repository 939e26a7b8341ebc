/** How far away a camera must be to show everything. */

import { cross, dot, unit, type Read3, type Vec3 } from "./vec";

/** From where to look at what. */
export interface Viewpoint {
  position: Vec3;
  target: Vec3;
}

/** What lies over a picture at its top and bottom: heights, px or as shares of the picture's. */
export interface Edges {
  readonly top: number;
  readonly bottom: number;
}

export const NO_EDGES: Edges = { top: 0, bottom: 0 };

/** The larger of two edges on each side. */
export const larger = (a: Edges, b: Edges): Edges => ({
  top: Math.max(a.top, b.top),
  bottom: Math.max(a.bottom, b.bottom),
});

/** Maximum share of the picture at one edge: what is higher covers the scene. */
const MOST_EDGE = 0.4;

/**
 * The nearest place from which all `points` are in sight between the edges, looking along `along` (unit).
 *
 * @param fov vertical, rad
 * @param aspect width by height of the picture
 * @param edges shares of the picture's height
 * @param margin share of the picture left free about it
 */
export function framed(
  points: readonly Read3[],
  along: Read3,
  fov: number,
  aspect: number,
  edges = NO_EDGES,
  margin = 0.08,
): Viewpoint {
  const right = unit(cross(along, [0, 0, 1]), [1, 0, 0]);
  const up = cross(right, along);
  const half = Math.tan(fov / 2);
  const wide = half * (1 - margin) * aspect;
  const reach = (edge: number) => half * (1 - margin - 2 * Math.min(edge, MOST_EDGE));
  const seen = points.map((point) => [dot(point, right), dot(point, up), dot(point, along)] as const);
  // -low * (z - from) <= x - center <= high * (z - from) for all: of each side the outermost bounds the place on its wedge's edge
  const wedge = (axis: 0 | 1, low: number, high: number) => {
    let most = -Infinity;
    let least = Infinity;
    for (const point of seen) {
      most = Math.max(most, point[axis] - high * point[2]);
      least = Math.min(least, point[axis] + low * point[2]);
    }
    return {
      center: (from: number) => (most + least + (high - low) * from) / 2,
      from: (least - most) / (low + high),
    };
  };
  const x = wedge(0, wide, wide);
  const y = wedge(1, reach(edges.bottom), reach(edges.top));
  let nearest = Infinity;
  let farthest = -Infinity;
  for (const point of seen) {
    nearest = Math.min(nearest, point[2]);
    farthest = Math.max(farthest, point[2]);
  }
  const from = Math.min(x.from, y.from, nearest - 0.5);
  const to = Math.max((nearest + farthest) / 2, from + 0.5);
  const at = (depth: number): Vec3 =>
    [0, 1, 2].map((i) => right[i]! * x.center(from) + up[i]! * y.center(from) + along[i]! * depth) as Vec3;
  return { position: at(from), target: at(to) };
}
