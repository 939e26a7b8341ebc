/** What is under the pointer, seen from above: the place in {W} that it means, with its height. */

import type { Environment } from "../messages";
import type { Vec3 } from "../geometry/vec";
import type { Polyline } from "../geometry/polyline";
import type { Lanes } from "./lanes";

/** An object that can be pointed at: its centre in {W} and half its extents, m. */
export interface Thing {
  readonly at: Readonly<Vec3>;
  readonly heading: number;
  readonly halfLength: number;
  readonly halfBreadth: number;
}

/**
 * The place that is meant by pointing at (x, y): on a lamp, an object, a strip, a belt, a solid's top, the floor.
 *
 * @param near how far from small things the pointer may be, m (lamps and strips are drawn to it)
 */
export function pointedPosition(
  map: Environment | null,
  lanes: Lanes,
  things: Iterable<Thing>,
  x: number,
  y: number,
  near: number,
): Vec3 {
  const lamp = nearestOf(map?.lamps ?? [], (each) =>
    Math.hypot(each.position_m[0] - x, each.position_m[1] - y),
  );
  if (lamp && lamp.apart <= near) return [...lamp.of.position_m];
  for (const thing of things) if (isOn(thing, x, y)) return [x, y, thing.at[2]];
  const strip = nearestOn(map?.strips ?? [], "strip", lanes, x, y);
  if (strip && strip.apart <= near / 2) return strip.at;
  const belt = nearestOf(map?.belts ?? [], (each) => {
    const line = lanes.line("belt", each.id);
    return line ? nearestTo(line, x, y).apart - each.width_m / 2 : Infinity;
  });
  if (belt && belt.apart <= 0) return [x, y, nearestTo(lanes.line("belt", belt.of.id)!, x, y).at[2]];
  if (strip && strip.apart <= near) return strip.at;
  return [x, y, topOf(map, x, y)];
}

/** The place on `line` nearest to (x, y) as seen from above, and how far it is, m. */
export function nearestTo(line: Polyline, x: number, y: number): { at: Vec3; apart: number } {
  let at: Vec3 = [...line.vertices[0]!];
  let apart = Infinity;
  for (let i = 1; i < line.vertices.length; i++) {
    const a = line.vertices[i - 1]!;
    const b = line.vertices[i]!;
    const dx = b[0] - a[0];
    const dy = b[1] - a[1];
    const squared = dx * dx + dy * dy;
    const share = squared > 0 ? Math.min(1, Math.max(0, ((x - a[0]) * dx + (y - a[1]) * dy) / squared)) : 0;
    const px = a[0] + share * dx;
    const py = a[1] + share * dy;
    const away = Math.hypot(px - x, py - y);
    if (away < apart) [at, apart] = [[px, py, a[2] + share * (b[2] - a[2])], away];
  }
  return { at, apart };
}

/** Height at (x, y): the highest solid's top, else the floor's. */
function topOf(map: Environment | null, x: number, y: number): number {
  let top = 0;
  for (const box of map?.boxes ?? []) {
    const [along, aside] = within(box.center_m, box.yaw_rad, x, y);
    if (Math.abs(along) <= box.size_m[0] / 2 && Math.abs(aside) <= box.size_m[1] / 2)
      top = Math.max(top, box.center_m[2] + box.size_m[2] / 2);
  }
  for (const tank of map?.cylinders ?? []) {
    if (Math.hypot(tank.center_m[0] - x, tank.center_m[1] - y) <= tank.radius_m)
      top = Math.max(top, tank.center_m[2] + tank.height_m);
  }
  for (const ball of map?.spheres ?? []) {
    const out = Math.hypot(ball.center_m[0] - x, ball.center_m[1] - y);
    if (out <= ball.radius_m)
      top = Math.max(top, ball.center_m[2] + Math.sqrt(ball.radius_m ** 2 - out ** 2));
  }
  for (const plane of map?.planes ?? []) {
    const isLevel = Math.abs(plane.normal[2]) > 0.99;
    if (!isLevel || !plane.size_m) continue;
    if (
      Math.abs(plane.center_m[0] - x) <= plane.size_m[0] / 2 &&
      Math.abs(plane.center_m[1] - y) <= plane.size_m[1] / 2
    )
      top = Math.max(top, plane.center_m[2]);
  }
  return top;
}

function isOn(thing: Thing, x: number, y: number): boolean {
  const [along, aside] = within(thing.at, thing.heading, x, y);
  return Math.abs(along) <= thing.halfLength && Math.abs(aside) <= thing.halfBreadth;
}

/** (x, y) in the axes of a solid at `center`, turned by `yaw`. */
function within(center: readonly number[], yaw: number, x: number, y: number): [number, number] {
  const dx = x - center[0]!;
  const dy = y - center[1]!;
  const c = Math.cos(yaw);
  const s = Math.sin(yaw);
  return [c * dx + s * dy, -s * dx + c * dy];
}

function nearestOn(
  strips: Environment["strips"],
  kind: string,
  lanes: Lanes,
  x: number,
  y: number,
): { at: Vec3; apart: number } | null {
  let best: { at: Vec3; apart: number } | null = null;
  for (const strip of strips) {
    const line = lanes.line(kind, strip.id);
    const found = line && nearestTo(line, x, y);
    if (found && (!best || found.apart < best.apart)) best = found;
  }
  return best;
}

function nearestOf<T>(all: readonly T[], apartOf: (each: T) => number): { of: T; apart: number } | null {
  let best: { of: T; apart: number } | null = null;
  for (const each of all) {
    const apart = apartOf(each);
    if (!best || apart < best.apart) best = { of: each, apart };
  }
  return best;
}
