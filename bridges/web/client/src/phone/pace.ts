/** When a phone says how it is turned: as often as it is worth, and still when nothing changes. Times in ms. */

import type { Quaternion } from "./orientation";

/** Readings that come sooner after the last that was sent are passed over: 60 a second, with some play. */
export const LEAST_MS = 12;
/** A phone that holds still says so this often; a silent one is taken for lost. */
export const STILL_MS = 160;
/** Maximum number of unsent bytes; beyond it nothing more is sent, since late samples are useless. */
export const MOST_BUFFERED = 4096;

export interface Reading {
  q: Quaternion;
  /** Of the phone's clock, which only goes forward. */
  t: number;
}

export class Pace {
  private newest: Reading | null = null;
  private isNew = false;
  private sentAt = -Infinity;
  private sentT = -Infinity;

  /** Take a reading. */
  read(q: Quaternion, t: number): void {
    this.newest = { q, t };
    this.isNew = true;
  }

  /** The sample to send at `now`, if any; it counts as sent. */
  due(now: number, buffered: number): Reading | null {
    if (!this.newest || buffered > MOST_BUFFERED) return null;
    const since = now - this.sentAt;
    if (this.isNew ? since < LEAST_MS : since < STILL_MS) return null;
    const t = Math.max(this.isNew ? this.newest.t : now, this.sentT);
    this.isNew = false;
    this.sentAt = now;
    this.sentT = t;
    return { q: this.newest.q, t };
  }

  /** Forget the reading: its sensor has stopped. */
  stop(): void {
    this.newest = null;
    this.isNew = false;
  }
}

/** Counts events per second. */
export class Rate {
  private times: number[] = [];

  tick(now: number): void {
    this.times.push(now);
  }

  /** How many in the second before `now`. */
  at(now: number): number {
    this.times = this.times.filter((time) => time > now - 1000);
    return this.times.length;
  }
}
