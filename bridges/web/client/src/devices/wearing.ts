/** The dialog for who has just put on a wrist: wear it, rest in two poses, point at the room. */

import type { Controls } from "../controls";
import { el, enable, sheet, show, write } from "../dom";
import { capital } from "../format";
import { Refusal, type Reply, type Wish } from "../site/asks";
import type { DeviceLine } from "../wire";

/** Both poses may take their whole patience, ms. */
const CHECK_MS = 75_000;

/** How devices of a plug-in are worn; others have their x axis towards the fingers. */
const WORN: Partial<Record<string, string>> = {
  metamotion: "its y axis towards the elbow, the button up",
  touch_sdk: "its screen outside; set on the watch which wrist wears it",
  xsens_dot: "in any direction",
};

export interface Wearing {
  open(line: DeviceLine): void;
  update(): void;
}

/** What the check of the mounting has found, in a sentence. */
export function fitSentence(reply: Record<string, unknown>): string {
  const about = Number(reply["about_arm_deg"]);
  const off = Number(reply["off_axis_deg"]);
  if (!Number.isFinite(about) || !Number.isFinite(off)) return "It is measured, and used from now on.";
  return Math.abs(about) < 10 && off < 10
    ? "It sits as assumed."
    : `It sits turned by ${Math.round(Math.abs(about))}° about the arm and ${Math.round(off)}° off its axis; that is corrected from now on.`;
}

export function wearingDialog(controls: Controls): Wearing {
  const title = el("h2");
  const text = el("p", {});
  const poses = el(
    "ol",
    {},
    el("li", {
      text: "Point level straight ahead, with the arm stretched and the palm down. Rest for two seconds.",
    }),
    el("li", { text: "Point straight up. Rest for two seconds." }),
  );
  const said = el("p", { role: "status" });
  const next = el(
    "button",
    { type: "button", className: "primary", onclick: () => void go() },
    el("span", {}),
  );
  const skip = el("button", { type: "button", onclick: () => enter(step + 1) }, el("span", { text: "Skip" }));
  const dialog = sheet(title, text, poses, said, el("div", { className: "pairs" }, next, skip));
  let device: DeviceLine | null = null;
  let step = 0;
  let isMeasuring = false;

  function enter(to: number): void {
    step = to;
    if (step > 2) {
      dialog.close();
      return;
    }
    const user = device?.name ?? "";
    const { localizes } = controls;
    write(title, [`${user}: wear it like this`, `${user}: point twice`, `${user}: point at the room`][step]!);
    write(
      text,
      [
        `On the wrist or forearm of the arm that points, tight, ${WORN[device?.plugin ?? ""] ?? "its x axis towards the fingers and its flat side on the arm"}. If it sits differently, the next step measures that.`,
        "Press Begin, and take each pose when you are ready. It goes on by itself.",
        localizes
          ? "Where you stand is not known yet: lamps light up one after the other, point at each."
          : "Stretch the arm and point at the middle of the room, as if a laser had to hit it.",
      ][step]!,
    );
    write(
      next.firstElementChild!,
      ["Next", "Begin", localizes ? "Find where I stand" : "I point there now"][step]!,
    );
    show(poses, step === 1);
    show(skip, step > 0);
    write(said, "");
  }

  async function go(): Promise<void> {
    if (!device) return;
    if (step === 0) enter(1);
    else if (step === 1) await measure(device);
    else {
      controls.choose(device.name);
      if (controls.localizes) controls.localize();
      else if (!(await ask({ deed: "centre", name: device.name }))) return;
      dialog.close();
    }
  }

  /** Ask, and say the reason of a refusal here: a toast is behind the dialog. */
  async function ask(wish: Wish, patienceMs?: number): Promise<Reply | null> {
    try {
      return await controls.connection.ask(wish, patienceMs);
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      write(said, capital(error.message));
      return null;
    }
  }

  async function measure(line: DeviceLine): Promise<void> {
    isMeasuring = true;
    for (const button of [next, skip]) enable(button, false);
    write(said, "Waiting for the wrist …");
    const reply = await ask({ deed: "check_mounting", query: { id: line.id } }, CHECK_MS);
    isMeasuring = false;
    for (const button of [next, skip]) enable(button, true);
    if (!reply) return;
    enter(2);
    write(said, fitSentence(reply));
  }

  return {
    open(line) {
      device = line;
      enter(0);
      if (!dialog.open) dialog.showModal();
    },
    update() {
      const line = controls.site.status?.devices.find(({ id }) => id === device?.id);
      if (isMeasuring && line?.said) write(said, capital(line.said));
    },
  };
}
