/** The mouse as a person's wrist: taking it, keeping it over a lost connection, giving it back. */

import type { Controls } from "./controls";
import { add, turn, type Vec3 } from "./geometry/vec";
import type { View } from "./view";

/** An arm that rests points to the floor so far before the feet, m. */
const REST_M = 0.4;
/** Minimum time of the mouse outside the stage, ms: its last target has been sent by then. */
const OUT_MS = 150;

export class Mouse {
  /** Person whose wrist this page requests, or "". */
  private wanted = "";
  private hadIt = false;
  private isAsking = false;
  private pointing = "";
  tremor = 0;
  private leaving: ReturnType<typeof setTimeout> | undefined;

  constructor(
    private readonly controls: Controls,
    private readonly view: () => View | null,
    stage: HTMLElement,
  ) {
    stage.addEventListener("pointerleave", ({ pointerType }) => {
      clearTimeout(this.leaving); // a finger that is lifted has not gone anywhere else
      if (pointerType === "mouse") this.leaving = setTimeout(() => this.rest(), OUT_MS);
    });
    stage.addEventListener("pointerenter", () => clearTimeout(this.leaving));
  }

  /** Take the wrist of `user`, the chosen person; the server has them begin to point if they rest. */
  async take(user = this.controls.user): Promise<void> {
    const { controls } = this;
    if (!user || !controls.mayDo("take") || this.isAsking) return;
    if (controls.mine && controls.mine.user !== user) await this.give();
    controls.choose(user);
    this.isAsking = true;
    const reply = await controls.ask({ deed: "take", name: user });
    this.isAsking = false;
    if (!reply) return;
    this.wanted = user;
    this.hadIt = false;
    document.getElementById("view")?.focus({ preventScroll: true });
    if (this.tremor) void this.shake(this.tremor);
  }

  /** Give it back: the person goes on where they were. */
  async give(): Promise<void> {
    const user = this.controls.mine?.user ?? "";
    this.wanted = "";
    this.hadIt = false;
    if (user) await this.controls.ask({ deed: "give", name: user });
  }

  /** Set the arm's tremor, degrees rms; returns the accepted value. */
  async shake(degrees: number): Promise<number | null> {
    this.tremor = degrees;
    const user = this.controls.mine?.user;
    if (!user) return degrees;
    const reply = await this.controls.ask({ deed: "tremor", name: user, query: { rms_deg: degrees } });
    return reply ? degrees : null;
  }

  /** Point there, {W}. */
  aim(at: Vec3): void {
    if (this.pointing) this.controls.connection.aim(this.pointing, at);
  }

  /** Let the arm hang, so that nothing is selected while the mouse is busy elsewhere; aiming again ends it. */
  private rest(): void {
    const person = this.controls.mine;
    if (!person?.pose || person.interaction?.state !== "pointing") return; // who is being found has to go on pointing at the lamp
    this.view()?.rest();
    this.aim(add(person.pose.position_m, turn([REST_M, 0, 0], person.pose.yaw_rad)));
  }

  /** Update from the server's status of the wrist. */
  update(): void {
    const { controls } = this;
    const { site } = controls;
    const user = controls.mine?.user ?? "";
    if (user !== this.pointing && site.connected) {
      this.pointing = user;
      this.view()?.setPointing(user !== "", user);
    }
    if (user && user === this.wanted) this.hadIt = true;
    const person = site.people.get(this.wanted);
    const line = person?.line;
    if (!this.wanted || user || !line || !site.connected || this.isAsking) return;
    if (line.moved_by !== "own") {
      if (this.hadIt)
        controls.toasts.show(
          "info",
          `${line.moved_by === "mouse" ? "Another page" : `A ${line.moved_by}`} points as ${this.wanted} now.`,
        );
      this.wanted = "";
    } else if (this.hadIt && controls.isPresent("imu-bridge", this.wanted) && person?.interaction) {
      this.hadIt = false; // after a lost connection, or a restarted server, which knows by now whether the person rests
      void this.take(this.wanted);
    }
  }

  /** A new view has to be told. */
  renew(): void {
    if (this.pointing) this.view()?.setPointing(true, this.pointing);
  }
}
