/** The mouse as a person's wrist: taking it, keeping it over a lost connection, giving it back. */

import type { Desk } from "./desk";
import { add, turn, type Vec3 } from "./geometry/vec";
import type { View } from "./view";

/** An arm that rests points to the floor so far before the feet, m. */
const REST_M = 0.4;
/** The mouse has to be out of the stage for so long, ms: what it pointed at last has been told by then. */
const OUT_MS = 150;

export class Mouse {
  /** Whose wrist this page wants to have; empty: nobody's. */
  private wanted = "";
  private hadIt = false;
  private isAsking = false;
  private pointing = "";
  tremor = 0;
  private leaving: ReturnType<typeof setTimeout> | undefined;

  constructor(private readonly desk: Desk, private readonly view: () => View | null, stage: HTMLElement) {
    stage.addEventListener("pointerleave", ({ pointerType }) => {
      clearTimeout(this.leaving); // a finger that is lifted has not gone anywhere else
      if (pointerType === "mouse") this.leaving = setTimeout(() => this.rest(), OUT_MS);
    });
    stage.addEventListener("pointerenter", () => clearTimeout(this.leaving));
  }

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

  /** Let the arm hang, so that nothing is selected while the mouse is busy elsewhere; aiming again ends it. */
  private rest(): void {
    const person = this.desk.mine;
    if (!person?.pose || person.interaction?.state !== "pointing") return; // who is being found has to go on pointing at the lamp
    this.view()?.rest();
    this.aim(add(person.pose.position_m, turn([REST_M, 0, 0], person.pose.yaw_rad)));
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
