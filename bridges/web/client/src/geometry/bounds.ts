/** Extent of a map that a camera must show. */

import type { Environment } from "../messages";
import type { Vec3 } from "./vec";

export interface Bounds {
  low: Vec3;
  high: Vec3;
}

/** Planes are shown as far as this, m, where they have no end. */
export const ENDLESS_M = 40;

/** What is on a belt, and its labels, takes up so much above it, m. */
const ABOVE_M = 0.4;

type Take = (at: readonly [number, number, number], aside?: number, up?: number, down?: number) => void;

/** Adds to `points` the corners about a place, and those below it: on the floor, unless `down` says how far. */
function taking(points: Vec3[]): Take {
  return ([x, y, z], aside = 0, up = 0, down = z) => {
    for (const [sx, sy] of aside
      ? [
          [-aside, -aside],
          [aside, -aside],
          [-aside, aside],
          [aside, aside],
        ]
      : [[0, 0]]) {
      points.push([x + sx!, y + sy!, z + up], [x + sx!, y + sy!, z - down]);
    }
  };
}

/** Corners of what people point at, in {W}, with the floor below it: lamps, strips, belts, boxes, things, other solids. */
export function aimsOf(map: Environment): Vec3[] {
  const points: Vec3[] = [];
  const take = taking(points);
  for (const lamp of map.lamps) take(lamp.position_m);
  for (const strip of map.strips) strip.line_m.forEach((vertex) => take(vertex));
  for (const belt of map.belts) belt.line_m.forEach((vertex) => take(vertex, belt.width_m / 2, ABOVE_M));
  for (const box of [...map.boxes, ...map.things.filter((thing) => !thing.is_tracked)])
    take(box.center_m, Math.hypot(box.size_m[0], box.size_m[1]) / 2, box.size_m[2] / 2);
  for (const ball of map.spheres) take(ball.center_m, ball.radius_m, ball.radius_m);
  for (const tank of map.cylinders) take(tank.center_m, tank.radius_m, tank.height_m);
  return points;
}

/** Corners of everything in the map that has an end, in {W}: what people point at, and walls, fences, clouds. */
export function pointsOf(map: Environment): Vec3[] {
  const points = aimsOf(map);
  const take = taking(points);
  for (const { center_m, normal, size_m } of map.planes) {
    const half = size_m ? Math.max(...size_m) / 2 : null;
    const rise = Math.hypot(normal[0], normal[1]);
    if (half !== null) take(center_m, half, half * rise, half * rise);
  }
  for (const fence of map.fences) for (const [x, y] of fence.outline_m) points.push([x, y, 0]);
  for (const cloud of map.clouds) points.push(cloud.low_m, cloud.high_m);
  return points;
}

/** What the map's things take up in {W}, with the floor (z 0); 4 m about the origin where there is nothing. */
export function boundsOf(map: Environment): Bounds {
  const points = pointsOf(map);
  const low: Vec3 = [Infinity, Infinity, 0];
  const high: Vec3 = [-Infinity, -Infinity, 0.5];
  if (!points.length) return { low: [-4, -4, 0], high: [4, 4, 2] };
  for (const point of points) {
    for (let axis = 0; axis < 3; axis++) {
      low[axis] = Math.min(low[axis]!, point[axis]!);
      high[axis] = Math.max(high[axis]!, point[axis]!);
    }
  }
  return { low, high };
}

/** The eight corners of `bounds`. */
export function cornersOf({ low, high }: Bounds): Vec3[] {
  return Array.from({ length: 8 }, (_, i): Vec3 => [
    (i & 1 ? high : low)[0],
    (i & 2 ? high : low)[1],
    (i & 4 ? high : low)[2],
  ]);
}
