/** The arm of a person that the wearer of this page's headset moves: taking it, pointing, giving it back. */

import type { Controls } from "./controls";
import type { Step } from "./messages";
import { Refusal, type Wish } from "./site/asks";
import type { Arm } from "./view";
import type { HeadsetMotion } from "./wire";

/** Time after the consent in which a status tells of it, ms; there is one a second. */
const CONFIRM_MS = 3000;
/** Limit of the server for the duration of a press, ms. */
const MAX_HELD_MS = 2000;

export class HeadsetArm implements Arm {
  /** Person whom the wearer points as, from the server's consent on; or "". */
  pointing = "";
  /** The server's status has told of it. */
  private isConfirmed = false;
  private isAsking = false;
  private takenAt = -Infinity;

  /** @param lost is told in a sentence that the wearer has lost the arm. */
  constructor(
    private readonly controls: Controls,
    private readonly lost: (sentence: string) => void,
  ) {}

  get user(): string {
    const { controls, pointing } = this;
    const { hello } = controls.site;
    return pointing || (controls.mayDo("take") ? controls.user : (hello?.user ?? ""));
  }

  async take(): Promise<string> {
    if (this.isAsking) return "The server has not answered yet: wait a moment.";
    this.isAsking = true;
    const { user } = this;
    const problem = await this.ask({ deed: "take", name: user, query: { by: "headset" } }).finally(
      () => (this.isAsking = false),
    );
    this.isConfirmed = false;
    this.takenAt = performance.now();
    this.pointing = problem ? "" : user;
    return problem;
  }

  give(): void {
    if (this.pointing) void this.ask({ deed: "give", name: this.pointing });
    this.pointing = "";
  }

  press(heldMs: number): Promise<string> {
    return this.ask({
      deed: "press",
      name: this.pointing,
      query: { held_s: Math.min(heldMs, MAX_HELD_MS) / 1000 },
    });
  }

  step(by: -1 | 1, to: Step["to"]): Promise<string> {
    return this.ask({ deed: "step", name: this.pointing, query: { by, to } });
  }

  move(measured: Pick<HeadsetMotion, "alignment" | "eyes_m" | "tip_m">): void {
    this.controls.connection.moveByHeadset({ kind: "headset", user: this.pointing, ...measured });
  }

  /** Update from the server's status: another page may have taken the arm, or the connection was lost. */
  update(): void {
    const line = this.controls.site.people.get(this.pointing)?.line;
    const isMine = line?.moved_by === "headset" && line.is_mine;
    if (isMine) this.isConfirmed = true;
    else if (this.pointing && (this.isConfirmed || !line || performance.now() - this.takenAt > CONFIRM_MS)) {
      const who = { own: "", mouse: "Another page", headset: "Another headset", phone: "A phone" }[
        line?.moved_by ?? "own"
      ];
      const user = this.pointing;
      this.pointing = "";
      this.lost(who ? `${who} points as ${user} now.` : `You do not point as ${user} any more.`);
    }
  }

  /** Ask, and return the reason of a refusal, or "". */
  private async ask(wish: Wish): Promise<string> {
    try {
      await this.controls.connection.ask(wish);
      return "";
    } catch (error) {
      if (error instanceof Refusal) return error.message;
      throw error;
    }
  }
}
