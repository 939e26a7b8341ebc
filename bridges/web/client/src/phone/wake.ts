/** Keeps the screen on while the phone is a wrist; browsers take that back whenever the page is out of sight. */

export class Wake {
  private lock: WakeLockSentinel | null = null;
  private isWanted = false;

  constructor() {
    document.addEventListener("visibilitychange", () => {
      if (this.isWanted) void this.take();
    });
  }

  /** Keep the screen on, or no longer. Never throws: a screen that goes dark is a nuisance, not a fault. */
  want(isWanted: boolean): void {
    this.isWanted = isWanted;
    if (isWanted) {
      void this.take();
      return;
    }
    void this.lock?.release().catch(() => undefined);
    this.lock = null;
  }

  private async take(): Promise<void> {
    if (
      document.visibilityState !== "visible" ||
      !("wakeLock" in navigator) ||
      (this.lock && !this.lock.released)
    )
      return;
    try {
      const lock = await navigator.wakeLock.request("screen");
      if (this.isWanted) this.lock = lock;
      else await lock.release();
    } catch {
      // Low battery, or not allowed here.
    }
  }
}
