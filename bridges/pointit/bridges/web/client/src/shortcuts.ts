/** What each key does. */

import type { Desk } from "./desk";
import type { Help } from "./help";
import type { Shortcut } from "./keys";
import type { Mouse } from "./mouse";
import type { Belts } from "./panel/belts";
import type { Look } from "./panel/look";
import type { Pairing } from "./panel/pairing";
import type { Panel } from "./panel/panel";
import type { Stage } from "./stage";
import { byName } from "./format";
import type { Camera } from "./view";

export interface Controls {
  desk: Desk;
  mouse: Mouse;
  stage: Stage;
  belts: Belts;
  look: Look;
  pairing: Pairing;
  panel: Panel;
  help: Help;
}

const SPEED_STEP = 0.1;
/** How far an arrow key moves the aimed-at place, m; with Shift less. */
const STEP_M = 0.06;
const SMALL_STEP_M = 0.015;
const ARROWS: Record<string, readonly [number, number]> = {
  ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1],
};

export function makeShortcuts({ desk, mouse, stage, belts, look, pairing, panel, help }: Controls): Shortcut[] {
  const camera = (key: string, name: Camera, does: string): Shortcut => ({
    keys: [key], shown: key, does, isOffered: () => stage.view?.cameras.includes(name) ?? false, run: () => stage.look(name),
  });
  const isMine = (): boolean => desk.mine !== null;
  return [
    { keys: [" "], shown: "Space", does: "Press the button at the wrist", isOffered: () => desk.mayDo("press") && desk.user !== "", run: () => desk.press() },
    { keys: ["m"], shown: "M", does: "Point with the mouse", isOffered: () => desk.mayDo("take") && desk.mine?.user !== desk.user, run: () => void mouse.take() },
    { keys: ["Escape"], shown: "Esc", does: "Give the arm back", isOffered: isMine, run: () => void mouse.give(), isSafe: true },
    {
      keys: Object.keys(ARROWS), shown: "← → ↑ ↓", does: "Move where you point; with Shift a little only", isOffered: isMine, isSafe: true,
      run: (event) => {
        const [right, away] = ARROWS[event.key]!;
        const step = event.shiftKey ? SMALL_STEP_M : STEP_M;
        stage.view?.nudge(right * step, away * step);
      },
    },
    { keys: ["q"], shown: "Q", does: "Point with a phone: show the QR code", isOffered: () => desk.mayDo("pair"), run: () => pairing.open() },
    { keys: ["l"], shown: "L", does: "Find out anew where the person stands", isOffered: () => desk.canLocalize, run: () => desk.localize() },
    { keys: ["c"], shown: "C", does: "Cancel that", isOffered: () => desk.localizes && desk.may("localizer/{user}/cancel"), run: () => desk.cancel() },
    { keys: ["u"], shown: "U", does: "Take back the last selection", isOffered: () => desk.may("selector/{user}/undo"), run: () => desk.undo() },
    { keys: ["x"], shown: "X", does: "Clear all that the person has selected", isOffered: () => desk.may("selector/{user}/clear"), run: () => desk.clear() },
    { keys: ["p"], shown: "P", does: "Add a package", isOffered: () => desk.may("conveyor/add_package"), run: () => belts.add() },
    { keys: ["s"], shown: "S", does: "Stop the belts, or start them", isOffered: () => desk.may("conveyor/set_speed"), run: () => belts.halt() },
    { keys: ["-"], shown: "−", does: "Slower belts", isOffered: () => desk.may("conveyor/set_speed"), run: () => belts.faster(-SPEED_STEP) },
    { keys: ["+", "="], shown: "+", does: "Faster belts", isOffered: () => desk.may("conveyor/set_speed"), run: () => belts.faster(SPEED_STEP) },
    {
      keys: ["n"], shown: "N", does: "The next person", isOffered: () => desk.site.people.size > 1,
      run: () => {
        const users = [...desk.site.people.keys()].sort(byName);
        desk.choose(users[(users.indexOf(desk.user) + 1) % users.length]!);
      },
    },
    camera("1", "room", "See the room"), camera("2", "top", "See it from above"), camera("3", "eyes", "See it with the person's eyes"),
    { keys: ["h"], shown: "H", does: "Controls, or health", isOffered: () => true, run: () => panel.turn() },
    { keys: ["v"], shown: "V", does: "Sounds on or off", isOffered: () => true, run: () => look.toggleSound() },
    { keys: ["?"], shown: "?", does: "This help", isOffered: () => true, run: () => help.open(), isSafe: true },
  ];
}
