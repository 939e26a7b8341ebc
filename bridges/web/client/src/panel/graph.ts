/** The latency of the last minute: median and 99th percentile of each second. */

import { el, mark } from "../dom";
import { latencyTick, milliseconds } from "../format";
import { draw } from "../plan/svg";
import type { Second } from "../site/timing";

const HEIGHT = 110;
/** Space for the labels of the axes, px. */
const LEFT = 44;
const RIGHT = 16;
const TOP = 8;
const FOOT = 20;
/** The vertical axis ends here at least, ms. */
const MIN_TOP_MS = 40;
/** Distance of the vertical lines, s, and at most so many of the horizontal ones. */
const TICK_S = 20;
const MAX_TICKS = 4;

/** Ticks of an axis from 0 to `top`: steps of 1, 2 or 5 times a power of ten. */
export function ticksTo(top: number): number[] {
  const least = top / MAX_TICKS;
  const power = 10 ** Math.floor(Math.log10(least));
  const step = power * ([1, 2, 5].find((each) => each * power >= least) ?? 10);
  return Array.from({ length: Math.floor(top / step) + 1 }, (_, index) => index * step);
}

/** A line through the values that are there, with gaps where there are none. */
export function lineThrough(
  values: readonly (number | null)[],
  x: (index: number) => number,
  y: (value: number) => number,
): string {
  return values
    .map((value, index) =>
      value === null
        ? ""
        : `${(values[index - 1] ?? null) === null ? "M" : "L"}${x(index).toFixed(1)} ${y(value).toFixed(1)}`,
    )
    .join("");
}

export class LatencyGraph {
  readonly element = el("div", {
    className: "graph",
    role: "img",
    "aria-label": "Latency of the last minute",
  });

  /** Show seconds, oldest first. */
  show(seconds: readonly Second[]): void {
    const width = this.element.clientWidth;
    const last = seconds[seconds.length - 2];
    if (!width) return;
    const top = Math.max(MIN_TOP_MS, 1.15 * Math.max(...seconds.map(({ p99 }) => p99 ?? 0)));
    const x = (index: number): number => LEFT + ((width - LEFT - RIGHT) * index) / (seconds.length - 1);
    const y = (ms: number): number => HEIGHT - FOOT - ((HEIGHT - FOOT - TOP) * ms) / top;
    this.element.replaceChildren();
    const svg = draw(this.element, "svg", { width, height: HEIGHT, "aria-hidden": "true" });
    for (const ms of ticksTo(top)) {
      draw(svg, "path", { class: "grid", d: `M${LEFT} ${y(ms)}H${width - RIGHT}` });
      draw(svg, "text", { x: LEFT - 6, y: y(ms) + 4, "text-anchor": "end" }, latencyTick(ms));
    }
    for (let age = 0; age < seconds.length; age += TICK_S) {
      draw(
        svg,
        "text",
        { x: x(seconds.length - 1 - age), y: HEIGHT - 4, "text-anchor": "middle" },
        age ? `−${age} s` : "now",
      );
    }
    for (const [name, values] of [
      ["broken", seconds.map(({ p99 }) => p99)],
      ["whole", seconds.map(({ p50 }) => p50)],
    ] as const) {
      draw(svg, "path", { class: name, d: lineThrough(values, x, y) });
    }
    mark(
      this.element,
      "aria-label",
      last?.p50 == null
        ? "Latency of the last minute: nothing to show"
        : `Latency of the last minute; in the last second ${milliseconds(last.p50)}, at worst ${milliseconds(last.p99)}`,
    );
  }
}
