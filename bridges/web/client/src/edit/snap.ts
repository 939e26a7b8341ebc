/** Snapping: onto walls, edges of boxes and ends of strips, parallel to them, at one height with others. Pure. */

import type { Item, Items } from "./model";
import { distanceTo, middleOf, outlineOf, turned, verticesOf, yawOf, type Vec } from "./shape";

/** An item snaps to a direction that differs by less, rad. */
export const NEARLY = (4 * Math.PI) / 180;

interface Edge {
  from: readonly [number, number];
  to: readonly [number, number];
  of: string;
}

/** Edges that others lie along: of walls (their middle line), boxes and things. */
function edgesOf(items: Items, but: Item): Edge[] {
  return items
    .filter((item) => item.id !== but.id && item.section !== "lamps" && item.section !== "strips")
    .flatMap((item) => {
      const corners = outlineOf(item);
      if (!corners) return [];
      if (item.section !== "planes")
        return corners.map((from, i) => ({ from, to: corners[(i + 1) % 4]!, of: item.name }));
      const between = (i: number, j: number): [number, number] => [
        (corners[i]![0] + corners[j]![0]) / 2,
        (corners[i]![1] + corners[j]![1]) / 2,
      ];
      return [{ from: between(0, 3), to: between(1, 2), of: item.name }];
    });
}

export interface Snapped {
  dx: number;
  dy: number;
  /** Onto what, or "". */
  onto: string;
}

/** The move nearest to (dx, dy) that puts `item` onto something within `reach` m: an end onto an end before a line onto a line. */
export function snapMove(item: Item, items: Items, dx: number, dy: number, reach: number): Snapped {
  const mine = verticesOf(item).map(([x, y]): [number, number] => [x + dx, y + dy]);
  const ends = item.section === "strips" ? [mine[0]!, mine.at(-1)!] : mine;
  let best: Snapped & { far: number } = { dx, dy, onto: "", far: reach };
  const take = (ax: number, ay: number, onto: string): void => {
    const far = Math.hypot(ax, ay);
    if (far < best.far) best = { dx: dx + ax, dy: dy + ay, onto, far };
  };
  if (item.section === "strips") {
    for (const other of items) {
      if (other.section !== "strips" || other.id === item.id) continue;
      for (const [x, y] of [verticesOf(other)[0]!, verticesOf(other).at(-1)!])
        for (const [ex, ey] of ends) take(x - ex, y - ey, `the end of ${other.name}`);
    }
  }
  if (best.onto || item.section === "planes") return best;
  for (const { from, to, of } of edgesOf(items, item)) {
    const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
    const [nx, ny] = [-(to[1] - from[1]) / length, (to[0] - from[0]) / length];
    for (const [ex, ey] of ends) {
      const along = ((ex - from[0]) * (to[0] - from[0]) + (ey - from[1]) * (to[1] - from[1])) / length;
      const off = (ex - from[0]) * nx + (ey - from[1]) * ny;
      if (along > -reach && along < length + reach) take(-off * nx, -off * ny, of);
    }
  }
  return best;
}

/** Directions to be parallel to: of the room, walls, boxes and strips, rad, with whose they are. */
function directions(items: Items, but: Item): [number, string][] {
  const found: [number, string][] = [[0, "the room"]];
  for (const item of items) {
    const yaw = item.id === but.id ? null : yawOf(item);
    if (yaw !== null) found.push([yaw, item.name]);
  }
  return found;
}

/** The difference of two lines' directions, a right angle being none, -45° to 45°. */
function between(a: number, b: number): number {
  const quarter = Math.PI / 2;
  const off = (a - b) % quarter;
  return off > quarter / 2 ? off - quarter : off < -quarter / 2 ? off + quarter : off;
}

/** The turn nearest to `by` that makes `item` parallel or square to something, if one is within `NEARLY`. */
export function snapTurn(item: Item, items: Items, by: number): { by: number; onto: string } {
  const yaw = yawOf(item);
  let best = { by, onto: "", off: NEARLY };
  if (yaw === null) return best;
  for (const [other, onto] of directions(items, item)) {
    const off = between(yaw + by, other);
    if (Math.abs(off) < best.off) best = { by: by - off, onto, off: Math.abs(off) };
  }
  return best;
}

/** The item parallel or square to the nearest wall, box or strip, and to which; null if there is none, or it has no direction. */
export function parallel(item: Item, items: Items): { item: Item; to: string } | null {
  const yaw = yawOf(item);
  const at = middleOf(item);
  if (yaw === null || !at) return null;
  const others = items.filter(
    (other) => other.id !== item.id && yawOf(other) !== null && verticesOf(other).length > 0,
  );
  const near = others.sort((a, b) => distanceTo(a, at[0], at[1]) - distanceTo(b, at[0], at[1]))[0];
  return near ? { item: turned(item, -between(yaw, yawOf(near)!)), to: near.name } : null;
}

/** The item at the height of the nearest other of its section, and of which; null if there is none. */
export function level(item: Item, items: Items): { vertices: Vec[]; to: string } | null {
  const at = middleOf(item);
  if (!at) return null;
  const others = items.filter(
    (other) => other.id !== item.id && other.section === item.section && middleOf(other),
  );
  const near = others.sort((a, b) => distanceTo(a, at[0], at[1]) - distanceTo(b, at[0], at[1]))[0];
  return near
    ? { vertices: verticesOf(item).map(([x, y]) => [x, y, middleOf(near)![2]]), to: near.name }
    : null;
}
