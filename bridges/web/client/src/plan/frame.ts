/** What part of the room the plan shows: pan and zoom. Screen places in px from the plan's upper left corner. */

import type { Bounds } from "../geometry/bounds";

/** `bounds` with `points` in them, seen from above. */
export function grown({ low, high }: Bounds, points: readonly (readonly [number, number, number])[]): Bounds {
  const side = (of: (...values: number[]) => number, from: readonly number[]) =>
    [0, 1, 2].map((axis) => of(from[axis]!, ...points.map((point) => point[axis]!))) as [
      number,
      number,
      number,
    ];
  return { low: side(Math.min, low), high: side(Math.max, high) };
}

/** A window onto {W}: `scale` px a metre, the place (x, y) in the middle. */
export class Frame {
  static readonly LEAST = 5;
  static readonly MOST = 3000;
  scale = 60;
  x = 0;
  y = 0;
  width = 1;
  height = 1;

  /** Show all of `bounds` with `margin` px about it. */
  fit(bounds: Bounds, margin: number): void {
    const { low, high } = bounds;
    const [wide, tall] = [Math.max(high[0] - low[0], 0.5), Math.max(high[1] - low[1], 0.5)];
    const fits = Math.min((this.width - 2 * margin) / wide, (this.height - 2 * margin) / tall);
    this.scale = clamp(fits, Frame.LEAST, 400);
    this.x = (low[0] + high[0]) / 2;
    this.y = (low[1] + high[1]) / 2;
  }

  /** Zoom by `factor`; what is at the screen's (px, py) stays there. */
  zoom(factor: number, px: number, py: number): void {
    const [x, y] = this.toWorld(px, py);
    this.scale = clamp(this.scale * factor, Frame.LEAST, Frame.MOST);
    const [nx, ny] = this.toWorld(px, py);
    this.x += x - nx;
    this.y += y - ny;
  }

  /** Move what is shown by so many px. */
  pan(dx: number, dy: number): void {
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
  }

  /** The place in {W} at a place of the screen. */
  toWorld(px: number, py: number): [number, number] {
    return [this.x + (px - this.width / 2) / this.scale, this.y - (py - this.height / 2) / this.scale];
  }

  /** Where a place in {W} is on the screen. */
  toScreen(x: number, y: number): [number, number] {
    return [this.width / 2 + (x - this.x) * this.scale, this.height / 2 - (y - this.y) * this.scale];
  }

  /** The transform of the plan's centimetres to px. */
  get transform(): string {
    const s = this.scale / 100;
    const [left, top] = [this.width / 2 - this.x * this.scale, this.height / 2 + this.y * this.scale];
    return `translate(${left.toFixed(2)} ${top.toFixed(2)}) scale(${s.toFixed(5)})`;
  }
}

/** A round length, m, that is between 60 and 150 px. */
export function scaleBar(scale: number): number {
  for (const metres of [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20])
    if (metres * scale >= 60) return metres;
  return 50;
}

function clamp(value: number, least: number, most: number): number {
  return Math.min(most, Math.max(least, value));
}
