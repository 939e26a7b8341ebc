/** The latency of the last minute: median and 99th percentile of each second. */

import { useLayoutEffect, useRef, useState } from "preact/hooks";
import { latencyTick, milliseconds } from "../format";
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

/** Seconds, oldest first. */
export function LatencyGraph({ seconds }: { seconds: readonly Second[] }) {
  const box = useRef<HTMLDivElement>(null);
  const [width, setWidth] = useState(0);
  useLayoutEffect(() => setWidth(box.current!.clientWidth));
  const top = Math.max(MIN_TOP_MS, 1.15 * Math.max(...seconds.map(({ p99 }) => p99 ?? 0)));
  const newest = seconds.length - 1;
  const x = (index: number): number => LEFT + ((width - LEFT - RIGHT) * index) / newest;
  const y = (ms: number): number => HEIGHT - FOOT - ((HEIGHT - FOOT - TOP) * ms) / top;
  const ages = Array.from({ length: Math.ceil(seconds.length / TICK_S) }, (_, index) => index * TICK_S);
  return (
    <div class="graph" role="img" aria-label={labelOf(seconds[newest - 1])} ref={box}>
      {width > 0 && (
        <svg width={width} height={HEIGHT} aria-hidden="true">
          {ticksTo(top).map((ms) => (
            <>
              <path class="grid" d={`M${LEFT} ${y(ms)}H${width - RIGHT}`} />
              <text x={LEFT - 6} y={y(ms) + 4} text-anchor="end">
                {latencyTick(ms)}
              </text>
            </>
          ))}
          {ages.map((age) => (
            <text x={x(newest - age)} y={HEIGHT - 4} text-anchor="middle">
              {age ? `−${age} s` : "now"}
            </text>
          ))}
          <path
            class="broken"
            d={lineThrough(
              seconds.map(({ p99 }) => p99),
              x,
              y,
            )}
          />
          <path
            class="whole"
            d={lineThrough(
              seconds.map(({ p50 }) => p50),
              x,
              y,
            )}
          />
        </svg>
      )}
    </div>
  );
}

function labelOf(last: Second | undefined): string {
  if (last?.p50 == null) return "Latency of the last minute: nothing to show";
  return `Latency of the last minute; in the last second ${milliseconds(last.p50)}, at worst ${milliseconds(last.p99)}`;
}
