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
  | {
      kind: "trouble";
      trouble: Trouble;
      /** Colour that was seen in place of the one asked for. */ shown?: Colour;
    };

/** Time without the awaited change, ms: the lights, the network or the camera do not follow. */
export const PATIENCE_MS = 2000;
/** Frames that are looked at after this time: the page itself may have been held up. */
const LEAST_FRAMES = 5;
/** A light that is larger than this share of the image's width outshines its neighbours. */
const WIDEST = 0.02;
/** Share of the image's width that a light may move from one frame to the next, and in a whole view. */
const REACH = 0.012;
const FARTHEST = 0.05;
/** Share of the lights that must have changed before a frame counts, while lights behind something are given up. */
const ENOUGH = 0.9;
/** Share of the first lights that must be left at the end. */
const LEAST_LEFT = 0.4;
/** Frames more for lights that have not changed when `ENOUGH` have. */
const GRACE = 2;
const WAIT: Verdict = { kind: "wait" };

interface Track {
  readonly start: Place;
  readonly colours: (Colour | null)[];
  u: number;
  v: number;
  count: number;
  /** Number of frames of the present step in which it had each colour. */
  readonly votes: [number, number, number];
}

export class Reader {
  /** The step that is shown. */
  step = 0;
  private readonly steps: number;
  private readonly reach: number;
  private readonly shift: Place = { u: 0, v: 0 };
  private first: Blob[] = [];
  private tracks: Track[] = [];
  /** Frames that came late in the present step. */
  private frames = 0;
  /** Frames for which the step has waited for the last lights. */
  private grace = 0;
  private beforeCount = -1;

  /** `slowMs`: lights may change that much later than others, as lamps on a bridge. */
  constructor(
    private readonly count: number,
    private readonly width: number,
    private readonly slowMs = 0,
  ) {
    this.steps = stepsOf(count);
    this.reach = Math.max(3, REACH * width);
  }

  /** Take the spots of a frame that came `sinceMs` after the present step was shown; null: too many spots. */
  take(blobs: readonly Blob[] | null, sinceMs: number): Verdict {
    const isLate = sinceMs > PATIENCE_MS && ++this.frames > LEAST_FRAMES;
    if (!blobs) return isLate ? { kind: "trouble", trouble: "crowd" } : WAIT;
    const isEarly = sinceMs < this.slowMs;
    if (this.step === 0) return this.takeFirst(blobs, isEarly, isLate);
    if (this.step === 1) return this.takeSecond(blobs, isEarly, isLate);
    return this.takeBit(blobs, isEarly, isLate);
  }

  /** All are red: as many as in the frame before. */
  private takeFirst(blobs: readonly Blob[], isEarly: boolean, isLate: boolean): Verdict {
    const isSettled =
      !isEarly && blobs.length > 0 && Math.abs(blobs.length - this.beforeCount) <= 0.1 * blobs.length;
    this.beforeCount = blobs.length;
    if (!isSettled) return isLate ? { kind: "trouble", trouble: "nothing" } : WAIT;
    this.first = [...blobs];
    return this.next();
  }

  /** Those of the red ones that are green now are lights of ours. */
  private takeSecond(blobs: readonly Blob[], isEarly: boolean, isLate: boolean): Verdict {
    const now = followed(this.first, blobs, this.shift, this.reach);
    const pairs = this.first.flatMap((first, i) =>
      now[i] && now[i].colour !== first.colour ? [{ first, now: now[i] }] : [],
    );
    const isSettled =
      pairs.length > 0 &&
      !(isEarly && pairs.length < this.first.length) &&
      Math.abs(pairs.length - this.beforeCount) <= 0.1 * pairs.length;
    this.beforeCount = pairs.length;
    if (!isSettled) return isLate ? { kind: "trouble", trouble: "nothing" } : WAIT;
    const right = pairs.filter(({ first, now: blob }) => first.colour === 0 && blob.colour === 1);
    if (right.length < pairs.length / 2) {
      const isFirst = pairs.some(({ first }) => first.colour !== 0);
      const shown = isFirst
        ? pairs.find(({ first }) => first.colour !== 0)!.first.colour
        : pairs.find(({ now: blob }) => blob.colour !== 1)!.now.colour;
      return { kind: "trouble", trouble: "colours", shown };
    }
    const areas = right.map(({ now: blob }) => blob.area);
    if (Math.sqrt(median(areas)) > WIDEST * this.width) return { kind: "trouble", trouble: "bloom" };
    if (median(areas) < 4) return { kind: "trouble", trouble: "faint" };
    this.tracks = right.map(({ first, now: blob }) => ({
      start: first,
      colours: [0, 1],
      u: first.u + blob.u - this.shift.u,
      v: first.v + blob.v - this.shift.v,
      count: 2,
      votes: [0, 0, 0],
    }));
    return this.next();
  }

  /** A light has its next colour when two frames agree; controllers may be of different delays. */
  private takeBit(blobs: readonly Blob[], isEarly: boolean, isLate: boolean): Verdict {
    const now = followed(
      this.tracks.map(({ start }) => start),
      blobs,
      this.shift,
      this.reach,
    );
    if (Math.hypot(this.shift.u, this.shift.v) > FARTHEST * this.width)
      return { kind: "trouble", trouble: "moved" };
    this.tracks.forEach((track, i) => {
      const blob = now[i];
      const last = track.colours.at(-1);
      if (!blob || last == null || blob.colour === last) return;
      track.votes[blob.colour]++;
      track.u += blob.u - this.shift.u;
      track.v += blob.v - this.shift.v;
      track.count++;
    });
    const live = this.tracks.filter(({ colours }) => colours.at(-1) != null);
    const share = live.filter(({ votes }) => Math.max(...votes) > 1).length / Math.max(1, live.length);
    if (share < (isLate ? LEAST_LEFT : ENOUGH)) return isLate ? { kind: "trouble", trouble: "lost" } : WAIT;
    if (share < 1 && !isLate && (isEarly || this.grace++ < GRACE)) return WAIT;
    for (const { colours, votes } of this.tracks) {
      const most = Math.max(...votes);
      colours.push(most > 1 ? (votes.indexOf(most) as Colour) : null);
      votes.fill(0);
    }
    return this.step + 1 < this.steps ? this.next() : this.read();
  }

  private next(): Verdict {
    this.beforeCount = -1;
    this.grace = this.frames = 0;
    return { kind: "show", step: ++this.step };
  }

  private read(): Verdict {
    const seen = this.tracks.flatMap(({ colours, u, v, count }) => {
      const index = indexOf(colours, this.count);
      return index === null ? [] : [{ index, u: u / count, v: v / count }];
    });
    if (seen.length < Math.max(1, LEAST_LEFT * this.tracks.length))
      return { kind: "trouble", trouble: "unread" };
    return { kind: "done", seen };
  }
}
