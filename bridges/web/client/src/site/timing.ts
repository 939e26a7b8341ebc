/** The page's estimate of the site's clock, and the latency of the display. */

/** Milliseconds over which the fastest batch is looked for. */
const WINDOW_MS = 10_000;
/** A larger difference counts as a step of the site's clock. */
const JUMP_MS = 5_000;

/**
 * Relates the site's time to `performance.now()`: of the batches of the last seconds, the one that travelled
 * fastest tells. What is left out is the least time that anything takes on its way, on one machine below 1 ms.
 */
export class SiteClock {
  private speed = 1;
  /** Arrivals and offsets (arrival less sending, ms of the page's clock); offsets rise from first to last. */
  private least: { at: number; offset: number }[] = [];

  /** Take note of a batch sent at `sentNs` that came `at`; return when it came if it had travelled fastest. */
  heard(sentNs: number, speed: number, at: number): number {
    if (!speed) return at; // a past that stands still
    const sent = sentNs / 1e6 / speed;
    const offset = at - sent;
    const known = this.least[0];
    if (speed !== this.speed || (known && Math.abs(offset - known.offset) > JUMP_MS)) this.least = [];
    this.speed = speed;
    while (this.least.length && this.least[this.least.length - 1]!.offset >= offset) this.least.pop();
    this.least.push({ at, offset });
    while (this.least[0]!.at < at - WINDOW_MS) this.least.shift();
    return sent + this.least[0]!.offset;
  }
}

/** Return the value below which the share `q` of `sorted` lies; nothing of nothing. */
export function quantile(sorted: ArrayLike<number>, q: number): number | null {
  if (!sorted.length) return null;
  const place = q * (sorted.length - 1);
  const below = Math.floor(place);
  const low = sorted[below]!;
  const high = sorted[Math.min(below + 1, sorted.length - 1)]!;
  return low + (high - low) * (place - below);
}

export interface Second {
  p50: number | null;
  p95: number | null;
  p99: number | null;
}

export function quantiles(values: readonly number[]): Second {
  const sorted = Float64Array.from(values).sort();
  return { p50: quantile(sorted, 0.5), p95: quantile(sorted, 0.95), p99: quantile(sorted, 0.99) };
}

/** Latencies of the last `seconds` whole seconds. */
export class LatencyHistory {
  private readonly seconds: number;
  private all: { at: number; ms: number }[] = [];

  constructor(seconds = 60) {
    this.seconds = seconds;
  }

  add(at: number, ms: number): void {
    this.all.push({ at, ms });
  }

  /** Quantiles over all that is kept, at `now` (ms). */
  total(now: number): Second {
    this.forget(now);
    return quantiles(this.all.map((each) => each.ms));
  }

  /** Quantiles of each second before `now`, oldest first; empty ones are null. */
  bySecond(now: number): Second[] {
    this.forget(now);
    const buckets: number[][] = Array.from({ length: this.seconds }, () => []);
    for (const { at, ms } of this.all) {
      const index = this.seconds - 1 - Math.floor((now - at) / 1000);
      buckets[Math.max(0, Math.min(this.seconds - 1, index))]!.push(ms);
    }
    return buckets.map(quantiles);
  }

  private forget(now: number): void {
    const since = now - this.seconds * 1000;
    const first = this.all.findIndex((each) => each.at >= since);
    if (first !== 0) this.all = first < 0 ? [] : this.all.slice(first);
  }
}
