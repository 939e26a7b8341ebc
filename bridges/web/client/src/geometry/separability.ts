/** Things that pointing alone tells apart, by the person's place on the floor: `Floor` of `model/separability.py`. */

export interface Separability {
  /** Edges of the squares, m in {W}, ascending. */
  readonly x_m: readonly number[];
  readonly y_m: readonly number[];
  readonly things: readonly string[];
  /** Number of things that are told apart, by row (y) and column (x). */
  readonly told_apart: readonly (readonly number[])[];
  /** Some pairs that are not, as indices of `things`. */
  readonly confused: readonly (readonly (readonly [number, number])[])[][];
  /** Some things to which a paced map knows no direction from there, as indices of `things`. */
  readonly uncovered?: readonly (readonly (readonly number[])[])[];
}

/** Opacity of a square from where nothing is told apart. */
const MOST = 0.72;

/** Opacity of a square by the number of things that are told apart from there: 0 if all are. */
export function confusion(separability: Separability, told: number): number {
  return MOST * (1 - told / Math.max(separability.things.length, 1));
}

/** What is told apart from (x, y), in words; "" outside the squares. */
export function separabilityText(
  { x_m, y_m, things, told_apart, confused, uncovered }: Separability,
  x: number,
  y: number,
): string {
  const column = between(x_m, x);
  const row = between(y_m, y);
  const told = told_apart[row]?.[column];
  if (told === undefined) return "";
  const pairs = confused[row]?.[column] ?? [];
  const count = things.length;
  const far = uncovered?.[row]?.[column] ?? [];
  if (far.length)
    return `${told} of ${count} told apart: this map was paced elsewhere and knows no direction to ${far.map((index) => things[index]).join(", ")} from there`;
  if (told === count) return `${count} of ${count} told apart`;
  const named = pairs.map(([one, other]) => `${things[one]} and ${things[other]}`);
  if (new Set(pairs.flat()).size < count - told) named.push("…");
  return `${told} of ${count} told apart, not ${named.join(", ")}`;
}

function between(edges: readonly number[], at: number): number {
  return edges.findIndex((edge, i) => i + 1 < edges.length && edge <= at && at < edges[i + 1]!);
}
