/** The dialog for who has just put on a wrist: wear it, rest in two poses, point at the room. */

import type { Controls } from "../controls";
import { capital } from "../format";
import { Refusal, type Reply, type Wish } from "../site/asks";
import { Dialog, placeDialog } from "../ui/dialog";
import { Button } from "../ui/elements";
import type { DeviceLine } from "../wire";

/** Both poses may take their whole patience, ms. */
const CHECK_TIMEOUT_MS = 75_000;
/** A wrist that is turned by less sits as assumed, degrees. */
const ASSUMED_DEG = 10;

/** How devices of a plug-in are worn; others have their x axis towards the fingers. */
const WORN: Partial<Record<string, string>> = {
  metamotion: "its y axis towards the elbow, the button up",
  touch_sdk: "its screen outside; set on the watch which wrist wears it",
  xsens_dot: "in any direction",
};
const USUALLY_WORN = "its x axis towards the fingers and its flat side on the arm";

/** Steps of the dialog. */
type Step = "wear" | "poses" | "room";

/** What a step says, and the name of the button that goes on. */
interface StepWords {
  title: string;
  text: string;
  next: string;
}

/** What the check of the mounting has found, in a sentence. */
export function fitSentence(reply: Record<string, unknown>): string {
  const about = Math.abs(Number(reply["about_arm_deg"]));
  const off = Number(reply["off_axis_deg"]);
  if (!Number.isFinite(about) || !Number.isFinite(off)) return "It is measured, and used from now on.";
  if (about < ASSUMED_DEG && off < ASSUMED_DEG) return "It sits as assumed.";
  return `It sits turned by ${Math.round(about)}° about the arm and ${Math.round(off)}° off its axis; that is corrected from now on.`;
}

/** Words of a step for the person `user` with a device of `plugin`; `localizes`: their position is found by pointing. */
export function wordsOfStep(step: Step, user: string, plugin: string, localizes: boolean): StepWords {
  switch (step) {
    case "wear":
      return {
        title: `${user}: wear it like this`,
        text: `On the wrist or forearm of the arm that points, tight, ${WORN[plugin] ?? USUALLY_WORN}. If it sits differently, the next step measures that.`,
        next: "Next",
      };
    case "poses":
      return {
        title: `${user}: point twice`,
        text: "Press Begin, and take each pose when you are ready. It goes on by itself.",
        next: "Begin",
      };
    case "room":
      return { title: `${user}: point at the room`, ...roomWords(localizes) };
  }
}

function roomWords(localizes: boolean): Omit<StepWords, "title"> {
  if (localizes)
    return {
      text: "Where you stand is not known yet: lamps light up one after the other, point at each.",
      next: "Find where I stand",
    };
  return {
    text: "Stretch the arm and point at the middle of the room, as if a laser had to hit it.",
    next: "I point there now",
  };
}

export class Wearing {
  private device: DeviceLine | null = null;
  private step: Step = "wear";
  private isMeasuring = false;
  private status = "";
  private readonly draw = placeDialog(() => this.view());

  constructor(private readonly controls: Controls) {}

  open(device: DeviceLine): void {
    this.device = device;
    this.enter("wear");
  }

  /** Follow what the wrist says while it is measured, and whether people are localized. */
  update(): void {
    if (!this.device) return;
    const line = this.controls.site.status?.devices.find(({ id }) => id === this.device?.id);
    if (this.isMeasuring && line?.said) this.status = capital(line.said);
    this.draw();
  }

  private enter(step: Step): void {
    this.step = step;
    this.tell("");
  }

  private close(): void {
    this.device = null;
    this.draw();
  }

  private async goOn(device: DeviceLine): Promise<void> {
    if (this.step === "wear") this.enter("poses");
    else if (this.step === "poses") await this.measure(device);
    else await this.pointAtRoom(device);
  }

  private skip(): void {
    if (this.step === "poses") this.enter("room");
    else this.close();
  }

  private async measure(device: DeviceLine): Promise<void> {
    this.isMeasuring = true;
    this.tell("Waiting for the wrist …");
    const reply = await this.ask({ deed: "check_mounting", query: { id: device.id } }, CHECK_TIMEOUT_MS);
    this.isMeasuring = false;
    this.draw();
    if (!reply) return;
    this.enter("room");
    this.tell(fitSentence(reply));
  }

  private async pointAtRoom(device: DeviceLine): Promise<void> {
    const { controls } = this;
    controls.choose(device.name);
    if (controls.localizes) controls.localize();
    else if (!(await this.ask({ deed: "centre", name: device.name }))) return;
    this.close();
  }

  /** Ask, and say the reason of a refusal here: a toast is behind the dialog. */
  private async ask(wish: Wish, timeoutMs?: number): Promise<Reply | null> {
    try {
      return await this.controls.connection.ask(wish, timeoutMs);
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      this.tell(capital(error.message));
      return null;
    }
  }

  private tell(status: string): void {
    this.status = status;
    this.draw();
  }

  private view() {
    const { device, step, isMeasuring } = this;
    const words = wordsOfStep(step, device?.name ?? "", device?.plugin ?? "", this.controls.localizes);
    return (
      <Dialog title={words.title} isOpen={device !== null} onClose={() => this.close()}>
        <p>{words.text}</p>
        {step === "poses" && (
          <ol>
            <li>
              Point level straight ahead, with the arm stretched and the palm down. Rest for two seconds.
            </li>
            <li>Point straight up. Rest for two seconds.</li>
          </ol>
        )}
        <p role="status">{this.status}</p>
        <div class="pairs">
          <Button
            name={words.next}
            kind="primary"
            isOff={isMeasuring}
            onClick={() => void this.goOn(device!)}
          />
          {step !== "wear" && <Button name="Skip" isOff={isMeasuring} onClick={() => this.skip()} />}
        </div>
      </Dialog>
    );
  }
}
