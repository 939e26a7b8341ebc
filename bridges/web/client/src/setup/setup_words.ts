/** What the cards of a home say, from the state of its set-up. Pure. */

import { capital } from "../format";
import type { HomeLamp, HomeSetup } from "../messages";
import type { PersonLine } from "../wire";

/** A card that is shown; `align`: the zero of the device is found again. */
export type Card = "connect" | "choose" | "hand" | "align" | "place" | "walk" | "try" | "";

const TITLES: Record<Exclude<Card, "">, string> = {
  connect: "Where are your lamps?",
  choose: "Which lamps do you want to point at?",
  hand: "What do you point with?",
  align: "Where do you point now?",
  place: "Where is each lamp?",
  walk: "Walk to a second place",
  try: "Try it",
};

/** Usual address of a Home Assistant. */
export const USUAL_URL = "http://homeassistant.local:8123";

/** Begin of the address of an MQTT broker. */
export const BROKER = "mqtt://";

/** Whether an address is that of an MQTT broker, on which lamps announce themselves. */
export function isBroker(url: string): boolean {
  return /^\s*(mqtts?|tcp|ssl|tls):\/\//i.test(url);
}

/** Address of the broker on which a search has found lamps, or which it has found. */
export function brokerOf(address: string): string {
  return address.includes("://") ? address : `${BROKER}${address}`;
}

/** Numbers of the cards, as people count them. */
const STEPS = ["connect", "choose", "hand", "place", "try"] as const;

export function cardOf(setup: HomeSetup): Card {
  if (setup.is_aligning) return "align";
  if (setup.step === "done") return "";
  if (setup.step === "place") return setup.may_walk ? "walk" : "place";
  return setup.step;
}

/** The card's own sentence, which says what there is to do. Its title is described by it. */
export const LEAD = "setup-lead";

export function titleOf(card: Exclude<Card, "">): string {
  return TITLES[card];
}

/** "Step 2 of 5". */
export function countOf(setup: HomeSetup): string {
  const index = STEPS.indexOf(setup.step as (typeof STEPS)[number]);
  return index < 0 ? "" : `Step ${index + 1} of ${STEPS.length}`;
}

/** The card before, or null at the first one. */
export function stepBefore(setup: HomeSetup): (typeof STEPS)[number] | null {
  const index = STEPS.indexOf(setup.step as (typeof STEPS)[number]);
  return STEPS[index - 1] ?? null;
}

export function nameOf(setup: HomeSetup, id: string): string {
  return setup.lamps.find((lamp) => lamp.id === id)?.label || id;
}

/** Page of a Home Assistant on which a token is made, or "" if the address is none. */
export function profileOf(url: string): string {
  try {
    const address = new URL(url.includes("://") ? url : `http://${url}`);
    return ["http:", "https:"].includes(address.protocol) ? `${address.origin}/profile/security` : "";
  } catch {
    return "";
  }
}

/** What there is to do at the card that places lamps, in sentences. */
export function placingText(setup: HomeSetup): string {
  const name = nameOf(setup, setup.target);
  const end = setup.end ? `the ${setup.end === "first" ? "beginning" : "end"} of ${name}` : name;
  const lit = setup.is_lit ? ", which is lit" : "";
  const off = setup.goes_off ? " It did not say whether it was on, so it is switched off afterwards." : "";
  if (setup.is_aligning)
    return `Stand at your ${placeName(setup.place)}. Point at ${end}${lit}, and press.${off}`;
  const stand = setup.place === "A" ? "Stand where you will point from most." : "Stay at your second place.";
  const lamp = setup.lamps.find(({ id }) => id === setup.target);
  const again = lamp?.reason ? ` Once more: ${lamp.reason}` : "";
  return `${stand} Point at ${end}${lit}, with a straight arm, and press.${off}${again}`;
}

export function progressText(setup: HomeSetup): string {
  const needed = setup.place === "B" ? 2 : 1;
  const count = setup.lamps.filter(({ places }) => places >= needed).length;
  return `${count} of ${setup.lamps.length} from your ${placeName(setup.place)}`;
}

/** The places as people know them: they are asked to walk from the first to the second. */
export function placeName(place: HomeSetup["place"]): string {
  return place === "B" ? "second place" : "first place";
}

/** How one presses at the cards that place lamps. */
export function pressText(hand: HomeSetup["hand"]): string {
  if (hand === "phone") return "To press, tap on the phone, or use Space or the button here.";
  return "To press, use the button at your wrist, or Space or the button here.";
}

/** What there is to do at the last card. */
export function tryText(hand: HomeSetup["hand"]): string {
  if (hand === "mouse") return "Take the arm with the mouse, and stay on a lamp: it switches.";
  return "Point elsewhere, then at a lamp: it brightens if it is on. Stay on it, or press, and it switches.";
}

/** State of a lamp as people say it, or "": scenes and buttons have the time of their last use instead. */
export function stateText(state: string): string {
  return /^\d/.test(state) ? "" : state;
}

/** A sentence with a capital and a full stop, or "". */
export function sentence(text: string): string {
  if (!text) return "";
  return /[.!?…]$/.test(text) ? capital(text) : `${capital(text)}.`;
}

/** What the search for Home Assistants has given. */
export function searchText(isSearching: boolean, count: number): string {
  if (isSearching) return "Looking for Home Assistants in your network …";
  if (count === 0) return "No Home Assistant was found in your network. Type its address.";
  return "Found in your network. Choose one, or type another address.";
}

/** What the search for lights has given. */
export function lightsText(isSearching: boolean, count: number): string {
  if (isSearching) return "Looking for lights in your network …";
  return count === 0 ? "No other light was found in your network." : "Found in your network:";
}

/** Whether the phone or the wristband that is to be used is there. */
export function handText(
  hand: HomeSetup["hand"],
  line: Pick<PersonLine, "moved_by" | "phone"> | null,
): string {
  if (hand === "mouse") return "Nothing is measured: lamps get places side by side.";
  if (hand === "wrist") return "Connect it under Devices of Set up, then return here.";
  if (line?.moved_by === "phone") return "The phone points.";
  return sentence(line?.phone || "no phone is paired yet");
}

export const WALK =
  "Walk about two metres to your left, and look at the lamps again. From two places, pointing works in between, too.";
export const STAY =
  "If you always sit in one chair, stay: lamps are then taken to be 3 m away, and pointing works from that chair only.";

/** Result for one lamp, in words. */
export function lampText({ label, id, direction_sigma_rad, reason, is_placed }: HomeLamp): string {
  const name = label || id;
  if (reason) return `${name}: not placed, ${reason}`;
  if (!is_placed) return `${name}: not placed`;
  const degrees = Math.round((Number(direction_sigma_rad ?? 0) * 180) / Math.PI);
  return degrees ? `${name}: direction known to ${degrees}°` : name;
}

/** Lamps by area, those without one last. */
export function byArea(lamps: readonly HomeLamp[]): [area: string, lamps: HomeLamp[]][] {
  const areas = new Map<string, HomeLamp[]>();
  for (const lamp of lamps) areas.set(lamp.area, [...(areas.get(lamp.area) ?? []), lamp]);
  return [...areas].sort(
    ([one], [other]) => Number(one === "") - Number(other === "") || one.localeCompare(other),
  );
}
