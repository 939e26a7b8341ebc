/** Where labels go, so that none lies on another or under a card. Pixels from the picture's upper left corner. */

export interface Rect {
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
}

export type Size = Pick<Rect, "width" | "height">;

/** A label wants its foot's middle to be at (x, y). */
export interface Wish {
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
  /** Of two that want one place, the greater has it; 0 or less: of something small, whose label stays close to it or is left out. */
  readonly rank: number;
  /** Where its upper left corner was: it stays there while there is room, so that it does not jump about. */
  readonly kept?: { readonly x: number; readonly y: number };
}

/** Between labels, px. */
const GAP = 3;
/** Maximum distance of a label from its object, px, by rank; less for small objects. */
const reachOf = (rank: number): number => (rank > 0 ? (rank < 1 ? 70 : 120) : 30);

/**
 * Where the upper left corner of each label is; null: there is no room near what it names.
 *
 * Labels take turns by rank; one whose place is taken goes to the nearest free place beside, above or below what
 * is in its way.
 *
 * @param taken areas without labels
 * @param picture how wide and high it is; labels are within it
 */
export function placed(
  wishes: readonly Wish[],
  taken: readonly Rect[],
  picture: Size,
): ({ x: number; y: number } | null)[] {
  const found = new Array<{ x: number; y: number } | null>(wishes.length).fill(null);
  const full = [...taken];
  const turns = wishes.map((_, i) => i).sort((a, b) => wishes[b]!.rank - wishes[a]!.rank || a - b);
  for (const i of turns) {
    const wish = wishes[i]!;
    const { width, height } = wish;
    const x = held(wish.x - width / 2, picture.width - width);
    const y = held(wish.y - height, picture.height - height);
    const kept = wish.kept && { ...wish.kept, width, height };
    const canStay =
      kept &&
      isWithin(kept, picture) &&
      Math.hypot(kept.x - x, kept.y - y) < reachOf(wish.rank) &&
      !full.some((each) => meet(kept, each));
    const at = canStay
      ? { x: kept.x, y: kept.y }
      : nearest({ x, y, width, height }, full, picture, reachOf(wish.rank));
    found[i] = at;
    if (at) full.push({ ...at, width, height });
  }
  return found;
}

function nearest(
  wanted: Rect,
  all: readonly Rect[],
  picture: Size,
  reach: number,
): { x: number; y: number } | null {
  if (!all.some((each) => meet(wanted, each))) return { x: wanted.x, y: wanted.y };
  let best: { x: number; y: number } | null = null;
  let least: number = reach;
  const { x: left, y: top, width: wide, height: tall } = wanted;
  const around = { x: left - reach, y: top - reach, width: wide + 2 * reach, height: tall + 2 * reach };
  const full = all.filter((each) => meet(around, each));
  const columns = [left];
  const rows = [top];
  for (const { x, y, width, height } of full) {
    columns.push(x - wanted.width - GAP, x + width + GAP);
    rows.push(y - wanted.height - GAP, y + height + GAP);
  }
  for (const x of columns) {
    for (const y of rows) {
      if (!isWithin({ ...wanted, x, y }, picture)) continue;
      const apart = Math.hypot(x - wanted.x, y - wanted.y);
      if (apart >= least || full.some((each) => meet({ ...wanted, x, y }, each))) continue;
      best = { x, y };
      least = apart;
    }
  }
  return best;
}

function isWithin({ x, y, width, height }: Rect, picture: Size): boolean {
  return x >= 0 && y >= 0 && x + width <= picture.width && y + height <= picture.height;
}

const held = (value: number, most: number): number => Math.max(0, Math.min(value, most));

function meet(a: Rect, b: Rect): boolean {
  return a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height;
}
