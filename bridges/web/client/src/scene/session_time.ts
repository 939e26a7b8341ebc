/** Time of a session as its wearer sees it: a frame that takes long, as on a busy device, neither holds a press nor ends a note. */

/** Maximum time that passes between two frames, ms. */
const MAX_FRAME_MS = 100;

export class SessionTime {
  /** Time of all sessions, ms. */
  ms = 0;
  private drawnAt = -Infinity;

  /** A frame is drawn now, ms of any clock. */
  advance(now: number): void {
    this.ms += Math.min(now - this.drawnAt, MAX_FRAME_MS);
    this.drawnAt = now;
  }
}
