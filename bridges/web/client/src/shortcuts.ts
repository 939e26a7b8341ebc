/** What each key does. */

import { SEPARABILITY_KEY } from "./separability_toggle";
import type { Controls } from "./controls";
import type { Help } from "./shell/help";
import { STEPS, type Shortcut } from "./keys";
import type { Mouse } from "./mouse";
import type { Belts } from "./belts/belts";
import type { SettingsDialog } from "./shell/settings_dialog";
import type { Pairing } from "./people/pairing";
import type { Panel } from "./panel/panel";
import type { Timeline } from "./past/timeline";
import type { Speaker } from "./speaker";
import type { Stage } from "./stage";
import { byName } from "./format";
import { movingOf, nounOf } from "./words";
import type { Camera } from "./view";

export interface ShortcutTargets {
  controls: Controls;
  mouse: Mouse;
  stage: Stage;
  belts: Belts;
  look: SettingsDialog;
  pairing: Pairing;
  panel: Panel;
  help: Help;
  timeline: Timeline;
  speaker: Speaker;
}

/** How far an arrow key moves in the past, s; with Shift less. */
const SKIP_S = 5;
const SMALL_SKIP_S = 1;
const SPEED_STEP = 0.1;
/** How far an arrow key moves the aimed-at place, m; with Shift less. */
const STEP_M = 0.06;
const SMALL_STEP_M = 0.015;
const ARROWS: Record<string, readonly [number, number]> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, 1],
  ArrowDown: [0, -1],
};

/** How to point with the keyboard, for who hears. */
export function beginning({ canStep, mine }: Controls): string {
  return `${canStep || mine ? "" : "M takes the arm. "}The arrow keys go from thing to thing, Home says where you are, Space confirms, Escape ends.`;
}

export function makeShortcuts({
  controls,
  mouse,
  stage,
  belts,
  look,
  pairing,
  panel,
  help,
  timeline,
  speaker,
}: ShortcutTargets): Shortcut[] {
  const camera = (key: string, name: Camera, does: string): Shortcut => ({
    keys: [key],
    shown: key,
    does,
    isOffered: () => stage.view?.cameras.includes(name) ?? false,
    run: () => stage.look(name),
  });
  const nudge = (event: KeyboardEvent): void => {
    const [right, away] = ARROWS[event.key]!;
    const step = event.shiftKey ? SMALL_STEP_M : STEP_M;
    stage.view?.nudge(right * step, away * step);
  };
  const isMine = (): boolean => controls.mine !== null;
  const isPast = (): boolean => controls.site.connected && controls.site.timeline !== null;
  const past = (
    keys: string[],
    shown: string,
    does: string,
    run: (event: KeyboardEvent) => void,
  ): Shortcut => ({ keys, shown, does, isOffered: isPast, run });
  return [
    past([" "], "Space", "Play or pause", () => timeline.toggle()),
    past(["ArrowLeft", "ArrowRight"], "← →", "Back or forth by 5 s; with Shift by 1 s", (event) =>
      timeline.skip((event.key === "ArrowLeft" ? -1 : 1) * (event.shiftKey ? SMALL_SKIP_S : SKIP_S)),
    ),
    past(
      ["e"],
      "E",
      "The next selection, miss, warning or change of state; with Shift the one before",
      (event) => timeline.event(event.shiftKey ? -1 : 1),
    ),
    past([","], ",", "The message before", () => timeline.step(-1)),
    past(["."], ".", "The next message", () => timeline.step(1)),
    past(["-"], "−", "Slower", () => timeline.faster(-1)),
    past(["+", "="], "+", "Faster", () => timeline.faster(1)),
    {
      keys: ["w"],
      shown: "W",
      does: "What just happened? The last ten minutes",
      isOffered: () => controls.site.connected && controls.site.timeline === null,
      run: () => controls.connection.visit(true),
    },
    {
      keys: ["Escape", "w"],
      shown: "Esc",
      does: "Back to live",
      isOffered: () => controls.site.timeline?.title === "",
      run: () => controls.connection.visit(false),
      isSafe: true,
    },
    {
      keys: [" "],
      shown: "Space",
      does: "Press the button at the wrist",
      isOffered: () => controls.mayDo("press") && controls.user !== "",
      run: () => controls.press(),
    },
    {
      keys: ["m"],
      shown: "M",
      does: "Point with the mouse",
      isOffered: () => controls.mayDo("take") && controls.mine?.user !== controls.user,
      run: () => void mouse.take(),
    },
    {
      keys: ["Escape"],
      shown: "Esc",
      does: "Give the arm back",
      isOffered: isMine,
      run: () => void mouse.give().then(() => controls.speaks && speaker.say("The arm is given back.")),
      isSafe: true,
    },
    {
      keys: Object.keys(STEPS),
      shown: "← → ↑ ↓",
      does: "To the nearest thing, then to the one beside it, or in the row above or below; Home says where you are; with Shift move where you point",
      isOffered: () => controls.canStep,
      isSafe: true,
      run: (event) =>
        event.shiftKey && isMine() && ARROWS[event.key] ? nudge(event) : controls.step(...STEPS[event.key]!),
    },
    {
      keys: Object.keys(ARROWS),
      shown: "← → ↑ ↓",
      does: "Move where you point; with Shift a little only",
      isOffered: isMine,
      isSafe: true,
      run: nudge,
    },
    {
      keys: Object.keys(STEPS),
      shown: "← → ↑ ↓",
      does: "How to point with the keyboard",
      isOffered: () => controls.speaks,
      isSafe: true,
      run: () => speaker.say(beginning(controls)),
    },
    {
      keys: ["q"],
      shown: "Q",
      does: "Point with a phone: show the QR code",
      isOffered: () => controls.mayDo("pair"),
      run: () => pairing.open(),
    },
    {
      keys: ["l"],
      shown: "L",
      does: "Localize the person again",
      isOffered: () => controls.canLocalize,
      run: () => controls.localize(),
    },
    {
      keys: ["c"],
      shown: "C",
      does: "Cancel that",
      isOffered: () => controls.localizes && controls.may("localizer/{user}/cancel"),
      run: () => controls.cancel(),
    },
    {
      keys: ["u"],
      shown: "U",
      does: "Undo the last selection of the person",
      isOffered: () => controls.may("selector/{user}/undo"),
      run: () => controls.undo(),
    },
    {
      keys: ["x"],
      shown: "X",
      does: "Clear all that the person has selected",
      isOffered: () => controls.may("selector/{user}/clear"),
      run: () => controls.clear(),
    },
    {
      keys: ["p"],
      shown: "P",
      does: () => `Add a ${nounOf(controls.site)}`,
      isOffered: () => controls.may("conveyor/add_package"),
      run: () => belts.add(),
    },
    {
      keys: ["s"],
      shown: "S",
      does: () => `Stop the ${movingOf(controls.site)}, or start them`,
      isOffered: () => controls.may("conveyor/set_speed"),
      run: () => belts.halt(),
    },
    {
      keys: ["r"],
      shown: "R",
      does: "Stop all robots",
      isOffered: () => controls.stoppable.length > 0,
      run: () => void controls.stopRobots(),
    },
    {
      keys: ["-"],
      shown: "−",
      does: () => `Slower ${movingOf(controls.site)}`,
      isOffered: () => controls.may("conveyor/set_speed"),
      run: () => belts.faster(-SPEED_STEP),
    },
    {
      keys: ["+", "="],
      shown: "+",
      does: () => `Faster ${movingOf(controls.site)}`,
      isOffered: () => controls.may("conveyor/set_speed"),
      run: () => belts.faster(SPEED_STEP),
    },
    {
      keys: ["n"],
      shown: "N",
      does: "The next person",
      isOffered: () => controls.site.people.size > 1,
      run: () => {
        const users = [...controls.site.people.keys()].sort(byName);
        controls.choose(users[(users.indexOf(controls.user) + 1) % users.length]!);
      },
    },
    camera("1", "room", "See the room"),
    camera("2", "top", "See it from above"),
    camera("3", "eyes", "See it with the person's eyes"),
    {
      keys: [SEPARABILITY_KEY.toLowerCase()],
      shown: SEPARABILITY_KEY,
      does: "Which things are told apart from where? Colour the floor",
      isOffered: () => stage.separability.isOffered,
      run: () => stage.separability.toggle(),
    },
    {
      keys: ["h"],
      shown: "H",
      does: "Control, set-up, or health",
      isOffered: () => true,
      run: () => panel.turn(),
    },
    {
      keys: ["v"],
      shown: "V",
      does: "Sounds on or off",
      isOffered: () => true,
      run: () => look.toggleSound(),
    },
    {
      keys: ["?"],
      shown: "?",
      does: "This help",
      isOffered: () => true,
      run: () => help.open(),
      isSafe: true,
    },
  ];
}
