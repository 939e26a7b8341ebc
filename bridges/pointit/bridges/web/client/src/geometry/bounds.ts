/** How large a map is: what a camera must show of it. */

import type { Environment } from "../messages";
import type { Vec3 } from "./vec";

export interface Bounds {
  low: Vec3;
  high: Vec3;
}

/** Planes are shown as far as this, m, where they have no end. */
export const ENDLESS_M = 40;

/** What the map's things take up in {W}, with the floor (z 0); 4 m about the origin where there is nothing. */
export function boundsOf(map: Environment, more: readonly (readonly [number, number, number])[] = []): Bounds {
  const low: Vec3 = [Infinity, Infinity, 0], high: Vec3 = [-Infinity, -Infinity, 0.5];
  const take = (point: readonly number[], aside = 0, above = 0) => {
    for (let axis = 0; axis < 3; axis++) {
      const by = axis < 2 ? aside : above;
      low[axis] = Math.min(low[axis]!, point[axis]! - by);
      high[axis] = Math.max(high[axis]!, point[axis]! + by);
    }
  };
  for (const lamp of map.lamps) take(lamp.position_m);
  for (const strip of map.strips) strip.line_m.forEach((vertex) => take(vertex));
  for (const belt of map.belts) belt.line_m.forEach((vertex) => take(vertex, belt.width_m / 2));
  for (const box of map.boxes) take(box.center_m, Math.hypot(box.size_m[0], box.size_m[1]) / 2, box.size_m[2] / 2);
  for (const ball of map.spheres) take(ball.center_m, ball.radius_m, ball.radius_m);
  for (const tank of map.cylinders) {
    take(tank.center_m, tank.radius_m);
    take([tank.center_m[0], tank.center_m[1], tank.center_m[2] + tank.height_m]);
  }
  for (const plane of map.planes) {
    const [x, y] = plane.normal;
    const half = plane.size_m ? Math.max(...plane.size_m) / 2 : null;
    if (half !== null) take(plane.center_m, half, half * Math.hypot(x, y));
  }
  for (const cloud of map.clouds) {
    take(cloud.low_m);
    take(cloud.high_m);
  }
  for (const point of more) take(point);
  if (low[0] > high[0]) return { low: [-4, -4, 0], high: [4, 4, 2] };
  return { low, high };
}
