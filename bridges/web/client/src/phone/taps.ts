/** Touches of the big button as gestures of the person's button. Times in ms. */

export type Gesture = "press" | "double" | "hold";

/** Minimum duration of a hold, ms. */
export const HOLD_MS = 800;
/** A second touch within this time makes a double press, where one is asked for. */
export const DOUBLE_MS = 320;

export class Taps {
  private downAt: number | null = null;
  private tappedAt: number | null = null;

  /** The finger is on the button. */
  down(now: number): void {
    this.downAt = now;
  }

  /** The finger has left it; `mayDouble`: wait whether it comes again. Returns the gesture that is complete. */
  up(now: number, mayDouble: boolean): Gesture | null {
    if (this.downAt === null) return null;
    this.downAt = null;
    if (!mayDouble) return "press";
    if (this.tappedAt !== null && now - this.tappedAt <= DOUBLE_MS) {
      this.tappedAt = null;
      return "double";
    }
    this.tappedAt = now;
    return null;
  }

  /** The touch was called off. */
  cancel(): void {
    this.downAt = null;
  }

  /** To be asked as time goes by: a hold is complete while the finger is down, a press when no second one came. */
  wait(now: number): Gesture | null {
    if (this.downAt !== null && now - this.downAt >= HOLD_MS) {
      this.downAt = this.tappedAt = null;
      return "hold";
    }
    if (this.tappedAt !== null && this.downAt === null && now - this.tappedAt > DOUBLE_MS) {
      this.tappedAt = null;
      return "press";
    }
    return null;
  }
}
