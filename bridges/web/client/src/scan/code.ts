/**
 * The numbers that lights blink, in colours: red, green, then a colour for each bit.
 *
 * Every light changes its colour at every step, by one place in red-green-blue for a 0 and by two for a 1. A
 * camera's frame is thus new when the lights have changed, whatever the network, controller and camera delay.
 * A light that did not change was hidden, or is no light of ours. Two check bits follow.
 */

/** 0 red, 1 green, 2 blue. */
export type Colour = 0 | 1 | 2;

const CHECK_BITS = 2;
/** Steps before the bits: all red, all green. */
export const FIRST_BIT = 2;

/** Number of bits that tell `count` lights apart. */
function bitsOf(count: number): number {
  return Math.max(1, Math.ceil(Math.log2(Math.max(1, count))));
}

/** Number of steps to show for `count` lights. */
export function stepsOf(count: number): number {
  return FIRST_BIT + bitsOf(count) + CHECK_BITS;
}

/** Colours of light `index` at each step. */
export function wordOf(index: number, count: number): Colour[] {
  const bits = Array.from({ length: bitsOf(count) }, (_, k) => (index >> (bitsOf(count) - 1 - k)) & 1);
  const check = checkOf(bits);
  const word: Colour[] = [0, 1];
  for (const bit of [...bits, check >> 1, check & 1]) word.push(((word.at(-1)! + 1 + bit) % 3) as Colour);
  return word;
}

/** The light that showed these colours, null for one unknown; null if they are no word of the code. */
export function indexOf(colours: readonly (Colour | null)[], count: number): number | null {
  if (colours.length !== stepsOf(count) || colours[0] !== 0 || colours[1] !== 1) return null;
  const bits: number[] = [];
  for (let k = FIRST_BIT; k < colours.length; k++) {
    const [before, now] = [colours[k - 1], colours[k]];
    if (before == null || now == null || before === now) return null;
    bits.push(((now - before + 3) % 3) - 1);
  }
  const [high, low] = bits.splice(-CHECK_BITS) as [number, number];
  if (checkOf(bits) !== 2 * high + low) return null;
  const index = bits.reduce((sum, bit) => 2 * sum + bit, 0);
  return index < count ? index : null;
}

/** A wrong colour turns two neighbouring bits over, which this weighted sum notices. */
function checkOf(bits: readonly number[]): number {
  return bits.reduce((sum, bit, k) => sum + (k + 1) * bit, 0) % 4;
}
