/** Choice of the transport to the server for the next try, and the delay before it. */

export type Transport = "socket" | "post";

/** Tries of the socket that may be refused before posts are tried: iOS refuses sockets on certificates it warned of. */
const REFUSALS = 2;
const FIRST_MS = 400;
const LONGEST_MS = 8000;

export class RetryPolicy {
  private refused = 0;
  private failed = 0;
  private last: Transport = "socket";

  /** Transport of the next try. Sockets first; then, as long as nothing works, both in turn. */
  nextTransport(): Transport {
    if (this.refused < REFUSALS) this.last = "socket";
    else this.last = this.failed > REFUSALS && this.last === "post" ? "socket" : "post";
    return this.last;
  }

  /** Note that the last tried transport works. */
  noteSuccess(): void {
    if (this.last === "socket") this.refused = 0;
    this.failed = 0;
  }

  /**
   * Note that the last tried transport does not work, or no longer.
   * @returns ms to wait before the next try.
   */
  noteFailure(wasOpen: boolean): number {
    if (this.last === "socket" && !wasOpen) this.refused += 1;
    this.failed += 1;
    return wasOpen ? FIRST_MS : Math.min(LONGEST_MS, FIRST_MS * 2 ** (this.failed - 1));
  }
}
