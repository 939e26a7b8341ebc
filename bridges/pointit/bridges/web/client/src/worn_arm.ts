/** The arm of a person that the wearer of this page's headset moves: taking it, pointing, giving it back. */

import type { Controls } from "./controls";
import { Refusal, type Wish } from "./site/asks";
import type { Arm } from "./view";
import type { Worn } from "./wire";

export class WornArm implements Arm {
  /** Person whom the wearer points as, from the server's consent on; or "". */
  pointing = "";
  /** The server's status has told of it. */
  private isConfirmed = false;

  constructor(private readonly controls: Controls) {}

  get user(): string {
    const { controls, pointing } = this, { hello } = controls.site;
    return pointing || (controls.mayDo("take") ? controls.user : hello?.user ?? "");
  }

  async take(): Promise<string> {
    const { user } = this, problem = await this.ask({ deed: "take", name: user, query: { by: "headset" } });
    this.isConfirmed = false;
    this.pointing = problem ? "" : user;
    return problem;
  }

  give(): void {
    if (this.pointing) void this.ask({ deed: "give", name: this.pointing });
    this.pointing = "";
  }

  press(): Promise<string> {
    return this.ask({ deed: "press", name: this.pointing });
  }

  step(by: -1 | 1): Promise<string> {
    return this.ask({ deed: "step", name: this.pointing, query: { by } });
  }

  move(measured: Pick<Worn, "alignment" | "eyes_m" | "tip_m">): void {
    this.controls.connection.wear({ kind: "worn", user: this.pointing, ...measured });
  }

  /** Update from the server's status: another page may have taken the arm, or the connection was lost. */
  update(): void {
    const line = this.controls.site.people.get(this.pointing)?.line, isMine = line?.moved_by === "headset" && line.is_mine;
    if (isMine) this.isConfirmed = true;
    else if (this.isConfirmed || !line) this.pointing = "";
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
