/** Which way to the server is tried next, and when. */

export type Way = "socket" | "post";

/** Tries of the socket that may be refused before posts are tried: iOS refuses sockets on certificates it warned of. */
const REFUSALS = 2;
const FIRST_MS = 400;
const LONGEST_MS = 8000;

export class Ladder {
  private refused = 0;
  private failed = 0;
  private last: Way = "socket";

  /** The way to try next. Sockets first; then, as long as nothing works, both in turn. */
  next(): Way {
    if (this.refused < REFUSALS) this.last = "socket";
    else this.last = this.failed > REFUSALS && this.last === "post" ? "socket" : "post";
    return this.last;
  }

  /** The way that was tried last works. */
  works(): void {
    if (this.last === "socket") this.refused = 0;
    this.failed = 0;
  }

  /**
   * The way that was tried last does not work, or no longer.
   * @returns ms to wait before the next try.
   */
  fails(wasOpen: boolean): number {
    if (this.last === "socket" && !wasOpen) this.refused += 1;
    this.failed += 1;
    return wasOpen ? FIRST_MS : Math.min(LONGEST_MS, FIRST_MS * 2 ** (this.failed - 1));
  }
}
