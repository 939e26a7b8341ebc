/** Reads one view: which step to show next, until every light's number and place are known, or why they are not. */

import { followed, median, type Blob, type Place } from "./blobs";
import { indexOf, stepsOf, type Colour } from "./code";

/** What hinders a view. */
export type Trouble = "nothing" | "bloom" | "faint" | "colours" | "moved" | "lost" | "crowd" | "unread";

/** Light `index` of the site's list, at an image position. */
export interface Seen extends Place {
  index: number;
}

export type Verdict =
  | { kind: "wait" }
  /** Show this step. */
  | { kind: "show"; step: number }
  | { kind: "done"; seen: Seen[] }
  | { kind: "trouble"; trouble: Trouble; /** Colour that was seen in place of the one asked for. */ shown?: Colour };

/** Time without the awaited change, ms: the lights, the network or the camera do not follow. */
export const PATIENCE_MS = 2500;
/** A light that is larger than this share of the image's width outshines its neighbours. */
const WIDEST = 0.02;
/** Share of the image's width that a light may move from one frame to the next, and in a whole view. */
const REACH = 0.012;
const FARTHEST = 0.05;
/** Share of the lights that must have changed before a frame counts, while lights behind something are given up. */
const ENOUGH = 0.9;
/** Share of the first lights that must be left at the end. */
const LEAST_LEFT = 0.4;
const WAIT: Verdict = { kind: "wait" };

interface Track {
  readonly start: Place;
  readonly colours: (Colour | null)[];
  u: number;
  v: number;
  count: number;
}

export class Reader {
  /** The step that is shown. */
  step = 0;
  private readonly steps: number;
  private readonly reach: number;
  private readonly shift: Place = { u: 0, v: 0 };
  private first: Blob[] = [];
  private tracks: Track[] = [];
  private before: (Blob | null)[] = [];
  private beforeCount = -1;

  constructor(private readonly count: number, private readonly width: number) {
    this.steps = stepsOf(count);
    this.reach = Math.max(3, REACH * width);
  }

  /** Take the spots of a frame that came `sinceMs` after the present step was shown; null: too many spots. */
  take(blobs: readonly Blob[] | null, sinceMs: number): Verdict {
    const isLate = sinceMs > PATIENCE_MS;
    if (!blobs) return isLate ? { kind: "trouble", trouble: "crowd" } : WAIT;
    if (this.step === 0) return this.takeFirst(blobs, isLate);
    if (this.step === 1) return this.takeSecond(blobs, isLate);
    return this.takeBit(blobs, isLate);
  }

  /** All are red: as many as in the frame before. */
  private takeFirst(blobs: readonly Blob[], isLate: boolean): Verdict {
    const isSettled = blobs.length > 0 && Math.abs(blobs.length - this.beforeCount) <= 0.1 * blobs.length;
    this.beforeCount = blobs.length;
    if (!isSettled) return isLate ? { kind: "trouble", trouble: "nothing" } : WAIT;
    this.first = [...blobs];
    return this.next();
  }

  /** Those of the red ones that are green now are lights of ours. */
  private takeSecond(blobs: readonly Blob[], isLate: boolean): Verdict {
    const now = followed(this.first, blobs, this.shift, this.reach);
    const pairs = this.first.flatMap((first, i) => (now[i] && now[i].colour !== first.colour ? [{ first, now: now[i] }] : []));
    const isSettled = pairs.length > 0 && Math.abs(pairs.length - this.beforeCount) <= 0.1 * pairs.length;
    this.beforeCount = pairs.length;
    if (!isSettled) return isLate ? { kind: "trouble", trouble: "nothing" } : WAIT;
    const right = pairs.filter(({ first, now: blob }) => first.colour === 0 && blob.colour === 1);
    if (right.length < pairs.length / 2) {
      const isFirst = pairs.some(({ first }) => first.colour !== 0);
      const shown = isFirst ? pairs.find(({ first }) => first.colour !== 0)!.first.colour : pairs.find(({ now: blob }) => blob.colour !== 1)!.now.colour;
      return { kind: "trouble", trouble: "colours", shown };
    }
    const areas = right.map(({ now: blob }) => blob.area);
    if (Math.sqrt(median(areas)) > WIDEST * this.width) return { kind: "trouble", trouble: "bloom" };
    if (median(areas) < 4) return { kind: "trouble", trouble: "faint" };
    this.tracks = right.map(({ first, now: blob }) => ({
      start: first, colours: [0, 1],
      u: first.u + blob.u - this.shift.u, v: first.v + blob.v - this.shift.v, count: 2,
    }));
    this.before = right.map(({ now: blob }) => blob);
    return this.next();
  }

  private takeBit(blobs: readonly Blob[], isLate: boolean): Verdict {
    const now = followed(this.tracks.map(({ start }) => start), blobs, this.shift, this.reach);
    const changed = this.tracks.map(({ colours }, i) => now[i] != null && colours.at(-1) != null && now[i].colour !== colours.at(-1));
    const live = this.tracks.filter(({ colours }) => colours.at(-1) != null).length;
    const share = changed.filter(Boolean).length / Math.max(1, live);
    const flickering = this.before.filter((blob, i) => changed[i] && blob?.colour !== now[i]?.colour).length;
    const isSame = flickering <= (1 - ENOUGH) / 2 * live;
    this.before = now;
    if (Math.hypot(this.shift.u, this.shift.v) > FARTHEST * this.width) return { kind: "trouble", trouble: "moved" };
    if (share < (isLate ? LEAST_LEFT : ENOUGH) || !isSame) return isLate ? { kind: "trouble", trouble: "lost" } : WAIT;
    this.tracks.forEach((track, i) => {
      const blob = now[i];
      track.colours.push(changed[i] && blob ? blob.colour : null);
      if (!changed[i] || !blob) return;
      track.u += blob.u - this.shift.u;
      track.v += blob.v - this.shift.v;
      track.count++;
    });
    return this.step + 1 < this.steps ? this.next() : this.read();
  }

  private next(): Verdict {
    this.beforeCount = -1;
    return { kind: "show", step: ++this.step };
  }

  private read(): Verdict {
    const seen = this.tracks.flatMap(({ colours, u, v, count }) => {
      const index = indexOf(colours, this.count);
      return index === null ? [] : [{ index, u: u / count, v: v / count }];
    });
    if (seen.length < Math.max(1, LEAST_LEFT * this.tracks.length)) return { kind: "trouble", trouble: "unread" };
    return { kind: "done", seen };
  }
}
