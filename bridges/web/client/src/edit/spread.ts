/** Places for things that have none: along the walls, so that nobody has to type a center. {W}, metres. Pure. */

import type { Item, Items } from "./model";
import { middleOf, mm, outlineOf, type Vec } from "./shape";

const HEIGHT_M = 1.2;
const SIZE_M: Vec = [0.3, 0.3, 0.3];
/** Distance of a thing's middle from its wall, m. */
const INSET_M = 0.2;
/** Distance of the walls that are assumed, where the map has none, from all that has a place, m. */
const MARGIN_M = 1;
/** Shortest side of the assumed room, m. */
const LEAST_SIDE_M = 4;
/** A plane whose normal rises more than this, as a share of its length, is no wall but a floor or a slope. */
const UPRIGHT = 0.5;

/** Part of a wall, from above; its inner side is on the left of the way from `from` to `to`. */
interface Side {
  readonly from: readonly [number, number];
  readonly to: readonly [number, number];
}

/** Things that nothing places: no center, no light, and nothing that they move with. */
export function unplacedOf(items: Items): Items {
  return items.filter(({ section, value }) => {
    const isPlaced = value["center"] || value["light"] || value["at"];
    return section === "things" && !isPlaced;
  });
}

/** The items, with all that have no place at equal distances along the walls, in their order. */
export function spreadAlongWalls(items: Items): Items {
  const unplaced = unplacedOf(items);
  const walls = wallsOf(items);
  const sides = walls.length ? walls : assumedSides(items);
  const totalM = sides.reduce((sum, side) => sum + lengthOf(side), 0);
  const placed = new Map<number, Item>();
  unplaced.forEach((item, index) => {
    const alongM = ((index + 0.5) / unplaced.length) * totalM;
    placed.set(item.id, placedAt(item, sides, alongM));
  });
  return items.map((item) => placed.get(item.id) ?? item);
}

/** Inner sides of the upright planes: their normals point into the room. */
function wallsOf(items: Items): Side[] {
  const sides: Side[] = [];
  for (const item of items) {
    const outline = outlineOf(item);
    if (item.section !== "planes" || !outline) continue;
    const [x, y, z] = item.value["normal"] as Vec;
    if (Math.abs(z) > UPRIGHT * Math.hypot(x, y, z)) continue;
    // The outline is that of a thin box: its middle line is the wall.
    const [a, b, c, d] = outline as [Point, Point, Point, Point];
    const from = between(a, d);
    const to = between(b, c);
    const isNormalLeft = (to[0] - from[0]) * y - (to[1] - from[1]) * x > 0;
    sides.push(isNormalLeft ? { from, to } : { from: to, to: from });
  }
  return sides;
}

type Point = readonly [number, number];

const between = (a: Point, b: Point): Point => [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];

/** Sides of a rectangle around all that has a place, counterclockwise. */
function assumedSides(items: Items): Side[] {
  const places = items.map(middleOf).filter((at) => at !== null);
  const [left, right] = widened(places.map(([x]) => x));
  const [low, high] = widened(places.map(([, y]) => y));
  const corners: Point[] = [
    [left, low],
    [right, low],
    [right, high],
    [left, high],
  ];
  return corners.map((from, index) => ({ from, to: corners[(index + 1) % corners.length]! }));
}

/** The range of `values` with a margin, and at least the shortest side of a room. */
function widened(values: readonly number[]): [number, number] {
  const low = values.length ? Math.min(...values) : 0;
  const high = values.length ? Math.max(...values) : 0;
  const half = Math.max((high - low) / 2 + MARGIN_M, LEAST_SIDE_M / 2);
  const middle = (low + high) / 2;
  return [middle - half, middle + half];
}

const lengthOf = ({ from, to }: Side): number => Math.hypot(to[0] - from[0], to[1] - from[1]);

/** The item on the inner side of the wall `alongM` from the start of the first one. */
function placedAt(item: Item, sides: readonly Side[], alongM: number): Item {
  let side = sides[0]!;
  let restM = alongM;
  for (const next of sides) {
    side = next;
    if (restM <= lengthOf(next)) break;
    restM -= lengthOf(next);
  }
  const length = lengthOf(side);
  const [ux, uy] = [(side.to[0] - side.from[0]) / length, (side.to[1] - side.from[1]) / length];
  const x = side.from[0] + restM * ux - INSET_M * uy;
  const y = side.from[1] + restM * uy + INSET_M * ux;
  const value: Record<string, unknown> = { ...item.value, center: [mm(x), mm(y), HEIGHT_M] };
  value["size"] ??= SIZE_M;
  const yawDeg = Math.round((Math.atan2(uy, ux) * 180) / Math.PI);
  if (yawDeg) value["yaw_deg"] = yawDeg;
  return { ...item, value };
}
