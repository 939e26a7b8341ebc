/** Alignment of a headset's space (levelled: z up) with {W}, from named positions that its wearer touched: a yaw and an origin. */

import type { Environment } from "../messages";
import { isOfThing } from "../site/site";
import { placeName } from "../words";
import { add, norm, scale, subtract, turn, type Read3, type Vec3 } from "./vec";

/** Number of positions that are touched. Two suffice, the third shows errors. */
export const TOUCHES = 3;
/** Minimum horizontal distance of the two outermost positions, m. Nearer ones give a poor yaw. */
export const MIN_APART_M = 0.5;
/** Largest number of positions that the wearer is asked to touch, one after the other. */
const MAX_LANDMARKS = 30;
/** Maximum residual of an alignment, m. */
export const MAX_RESIDUAL_M = 0.15;
/** Minimum improvement of the residual by another order of the positions, m, that shows that some were swapped. */
const SWAP_M = 0.05;

/** A named position in {W} that can be touched. */
export interface Landmark {
  readonly name: string;
  readonly at: Read3;
}

export interface Touch extends Landmark {
  /** In the headset's space, levelled, m. */
  readonly touched: Read3;
}

/** The headset's space in {W}. */
export interface Alignment {
  readonly yaw: number;
  readonly origin: Read3;
}

export interface Assessment {
  readonly alignment: Alignment;
  /** Root mean square distance of touched and mapped positions, m, corrected for the four fitted unknowns. */
  readonly residual_m: number;
  /** Error message, or "". */
  readonly fault: string;
  /** What the touches cannot show, or "". */
  readonly caution: string;
}

/** A position of WebXR (y up) with z up. */
export const leveled = ({ x, y, z }: Pick<DOMPointReadOnly, "x" | "y" | "z">): Vec3 => [x, -z, y];

/** Azimuth of a WebXR orientation's x axis in the levelled space, rad. */
export const headingOf = ({ x, y, z, w }: Pick<DOMPointReadOnly, "x" | "y" | "z" | "w">): number =>
  Math.atan2(2 * (w * y - x * z), 1 - 2 * (y * y + z * z));

/** A levelled position in {W}. */
export const mapped = ({ yaw, origin }: Alignment, touched: Read3): Vec3 => add(turn(touched, yaw), origin);

/** The alignment with which `touched` (heading `heading`, levelled) is at `at`, {W}, with the azimuth `yaw`. */
export function alignmentFrom(at: Read3, yaw: number, touched: Read3, heading: number): Alignment {
  const turned = yaw - heading;
  return { yaw: turned, origin: subtract(at, turn(touched, turned)) };
}

/** `alignment` of a space whose new origin is at `at` with the azimuth `heading`, in the former levelled space. */
export const reoriented = (alignment: Alignment, at: Read3, heading: number): Alignment => ({
  yaw: alignment.yaw + heading,
  origin: mapped(alignment, at),
});

/** Lamps and things that can be touched. Each is farther from those before it than those after it. */
export function landmarksOf(map: Environment): Landmark[] {
  const rest: Landmark[] = [
    ...map.lamps
      .filter(({ id }) => !isOfThing(map, id))
      .map(({ id, position_m }) => ({ name: placeName(id, "lamp"), at: position_m })),
    ...map.things
      .filter((thing) => !thing.is_tracked)
      .map(({ id, label, center_m, size_m }) => ({
        name: `the middle of the top of ${label || placeName(id, "thing")}`,
        at: add(center_m, [0, 0, size_m[2] / 2]),
      })),
  ];
  const order = [...outermost(rest)[0]];
  for (
    let left = rest.filter((each) => !order.includes(each));
    left.length && order.length < MAX_LANDMARKS;
    left = left.filter((each) => !order.includes(each))
  ) {
    const nearest = (each: Landmark): number =>
      order.reduce((least, other) => Math.min(least, norm(subtract(each.at, other.at))), Infinity);
    const [first] = left
      .map((each) => [each, nearest(each)] as const)
      .reduce((best, each) => (each[1] > best[1] ? each : best));
    order.push(first);
  }
  return order;
}

/** Whether `landmarks` are far enough apart for an alignment. */
export const canAlign = (landmarks: readonly Landmark[]): boolean => apart(landmarks) >= MIN_APART_M;

/** Least squares alignment of two or more touches, and its errors. */
export function assess(touches: readonly Touch[]): Assessment {
  const [alignment, residual_m] = fitted(touches, touches);
  const others = permutations(touches)
    .slice(1)
    .map((order) => ({ order, residual: fitted(touches, order)[1] }));
  const other = others.reduce((best, each) => (each.residual < best.residual ? each : best));
  const swapped = touches
    .filter(({ name }, i) => other.order[i]!.name !== name)
    .map(({ name }) => name)
    .join(" and ");
  let fault = "";
  let caution = "";
  if (Math.min(apart(touches), apart(touches.map(({ touched }) => ({ at: touched })))) < MIN_APART_M) {
    fault = `The positions that you touched are less than ${MIN_APART_M} m apart: touch others.`;
  } else if (residual_m - other.residual > SWAP_M && other.residual < residual_m / 2) {
    fault = `You have probably swapped ${swapped}: touch them again.`;
  } else if (!(residual_m <= MAX_RESIDUAL_M)) {
    const [a, b] = worstPair(touches);
    fault = `${a.name} and ${b.name}: ${meters(norm(subtract(a.touched, b.touched)))} between your touches, ${meters(norm(subtract(a.at, b.at)))} in the map. Touch them again, or correct the map.`;
  } else if (other.residual < residual_m + SWAP_M)
    caution = `If you swapped ${swapped}, the distances do not show it.`;
  return { alignment, residual_m, fault, caution };
}

const meters = (value: number): string => `${value.toFixed(2)} m`;

/** Largest horizontal distance within `points`, m. */
const apart = (points: readonly { readonly at: Read3 }[]): number => outermost(points)[1];

/** The two `points` farthest apart horizontally, and their distance, m. All of them if there are less than two. */
function outermost<P extends { readonly at: Read3 }>(points: readonly P[]): [readonly P[], number] {
  let most: [readonly P[], number] = [points.slice(0, 2), 0];
  points.forEach((a, i) => {
    for (const b of points.slice(i + 1)) {
      const distance = Math.hypot(a.at[0] - b.at[0], a.at[1] - b.at[1]);
      if (distance > most[1]) most = [[a, b], distance];
    }
  });
  return most;
}

function worstPair(touches: readonly Touch[]): [Touch, Touch] {
  const pairs = touches.flatMap((a, i) => touches.slice(i + 1).map((b): [Touch, Touch] => [a, b]));
  const error = ([a, b]: [Touch, Touch]): number =>
    Math.abs(norm(subtract(a.touched, b.touched)) - norm(subtract(a.at, b.at)));
  return pairs.reduce((worst, pair) => (error(pair) > error(worst) ? pair : worst));
}

/** The alignment of what was touched with the positions of `marks`, and its residual, m. */
function fitted(touches: readonly Touch[], marks: readonly Landmark[]): [Alignment, number] {
  const mean = (points: readonly Read3[]): Vec3 =>
    scale(
      points.reduce<Vec3>((sum, each) => add(sum, each), [0, 0, 0]),
      1 / points.length,
    );
  const from = mean(touches.map(({ touched }) => touched));
  const to = mean(marks.map(({ at }) => at));
  let cosine = 0;
  let sine = 0;
  touches.forEach(({ touched }, i) => {
    const a = subtract(touched, from);
    const b = subtract(marks[i]!.at, to);
    cosine += a[0] * b[0] + a[1] * b[1];
    sine += a[0] * b[1] - a[1] * b[0];
  });
  const alignment = alignmentFrom(to, Math.atan2(sine, cosine), from, 0);
  const squares = touches.reduce(
    (sum, { touched }, i) => sum + norm(subtract(mapped(alignment, touched), marks[i]!.at)) ** 2,
    0,
  );
  return [alignment, Math.sqrt((3 * squares) / (3 * touches.length - 4))];
}

/** All orders of `items`; the first is that of `items`. */
function permutations<T>(items: readonly T[]): T[][] {
  if (items.length < 2) return [[...items]];
  return items.flatMap((first, i) =>
    permutations([...items.slice(0, i), ...items.slice(i + 1)]).map((rest) => [first, ...rest]),
  );
}
