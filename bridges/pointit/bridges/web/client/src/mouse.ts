/** The mouse as a person's wrist: taking it, keeping it over a lost connection, giving it back. */

import type { Desk } from "./desk";
import type { Vec3 } from "./geometry/vec";
import type { View } from "./view";

export class Mouse {
  /** Whose wrist this page wants to have; empty: nobody's. */
  private wanted = "";
  private hadIt = false;
  private isAsking = false;
  private pointing = "";
  tremor = 0;

  constructor(private readonly desk: Desk, private readonly view: () => View | null) {}

  /** Take the wrist of the chosen person; the server has them begin to point. */
  async take(): Promise<void> {
    const { desk } = this;
    const { user } = desk;
    if (!user || !desk.mayDo("take") || this.isAsking) return;
    if (desk.mine && desk.mine.user !== user) await this.give();
    desk.choose(user);
    this.isAsking = true;
    const reply = await desk.ask({ deed: "take", name: user }, { isQuiet: true });
    this.isAsking = false;
    if (!reply) return;
    this.wanted = user;
    this.hadIt = false;
    document.getElementById("view")?.focus({ preventScroll: true });
    if (this.tremor) void this.shake(this.tremor);
  }

  /** Give it back: the person goes on where they were. */
  async give(): Promise<void> {
    const user = this.desk.mine?.user ?? "";
    this.wanted = "";
    this.hadIt = false;
    if (user) await this.desk.ask({ deed: "give", name: user }, { isQuiet: true });
  }

  /** Let the arm tremble, degrees rms; returns what was taken. */
  async shake(degrees: number): Promise<number | null> {
    this.tremor = degrees;
    const user = this.desk.mine?.user;
    if (!user) return degrees;
    const reply = await this.desk.ask({ deed: "tremor", name: user, query: { rms_deg: degrees } }, { isQuiet: true });
    return reply ? degrees : null;
  }

  /** Point there, {W}. */
  aim(at: Vec3): void {
    if (this.pointing) this.desk.connection.aim(this.pointing, at);
  }

  /** Follow what the server says of who has the wrist. */
  update(): void {
    const { desk } = this;
    const { site } = desk;
    const user = desk.mine?.user ?? "";
    if (user !== this.pointing && site.connected) {
      this.pointing = user;
      this.view()?.setPointing(user !== "", user);
    }
    if (user && user === this.wanted) this.hadIt = true;
    const line = site.people.get(this.wanted)?.line;
    if (!this.wanted || user || !line || !site.connected || this.isAsking) return;
    if (line.moved_by !== "own") {
      if (this.hadIt) desk.toasts.show("info", `${line.moved_by === "phone" ? "A phone" : "Another page"} points as ${this.wanted} now.`);
      this.wanted = "";
    } else if (this.hadIt) {
      this.hadIt = false;
      void this.take(); // after a lost connection or a restarted server
    }
  }

  /** A new view has to be told. */
  renew(): void {
    if (this.pointing) this.view()?.setPointing(true, this.pointing);
  }
}
