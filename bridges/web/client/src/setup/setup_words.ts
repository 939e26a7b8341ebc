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

/** What a home's lamps are asked of. */
export type HomeServer = "home" | "broker" | "none";

export const HOME_KINDS = [
  { value: "home", label: "Home Assistant", icon: "home" },
  { value: "broker", label: "MQTT broker", icon: "wifi" },
  { value: "none", label: "Neither", icon: "bulb" },
];

/** Usual ports of brokers, which no Home Assistant has. */
const BROKER_PORT = /:(1883|8883)\/?$/;

/** What an address belongs to by its scheme or port, or "" if it may be either. */
export function homeKindOf(url: string): "broker" | "" {
  return isBroker(url) || BROKER_PORT.test(url.trim()) ? "broker" : "";
}

/** The address that is tried, of what was typed for `kind`: with a scheme. */
export function addressOf(typed: string, kind: HomeServer): string {
  const url = typed.trim();
  if (kind !== "broker" || !url) return url;
  return isBroker(url) ? url : `${BROKER}${url.replace(/^[a-z]+:\/\//i, "")}`;
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
  if (setup.step === "place") return setup.may_walk || setup.is_short_walk ? "walk" : "place";
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

/** "2 of 4 lamps from your first place", the summary of those that can be pointed at once more. */
export function repeatText(setup: HomeSetup): string {
  const needed = setup.place === "B" ? 2 : 1;
  const count = setup.lamps.filter(({ places }) => places >= needed).length;
  return `${count} of ${setup.lamps.length} from your ${placeName(setup.place)}. One again?`;
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

/** State of a lamp as people say it, or "": scenes and buttons have the time of their last use instead. */
export function stateText(state: string): string {
  return /^\d/.test(state) ? "" : state;
}

/** A sentence with a capital and a full stop, or "". */
export function sentence(text: string): string {
  if (!text) return "";
  return /[.!?…]$/.test(text) ? capital(text) : `${capital(text)}.`;
}

/** What the search for Home Assistants, or for brokers, has given. */
export function searchText(isSearching: boolean, count: number, kind: HomeServer): string {
  const name = kind === "broker" ? "MQTT broker" : "Home Assistant";
  if (isSearching) return `Looking for a ${name} in your network …`;
  if (count === 0) return `No ${name} was found in your network. Type its address.`;
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

/** Result for one lamp, in words. */
export function lampText({ label, id, quality, reason, is_placed }: HomeLamp): string {
  const name = label || id;
  if (reason) return `${name}: ${reason}`;
  if (!is_placed) return name;
  return quality === "again"
    ? `${name}: not sure, point at it again`
    : quality
      ? `${name}: ${quality}`
      : name;
}

/** How many lamps have reacted when they were meant. */
export function tryCountText(lamps: readonly HomeLamp[]): string {
  const placed = lamps.filter(({ is_placed }) => is_placed);
  const met = placed.filter(({ is_met }) => is_met);
  return `${met.length} of ${placed.length} tried`;
}

/** Things that are lamps, and dangerous things, by their kind. */
const LAMP_KINDS: readonly HomeLamp["kind"][] = ["lamp", "ceiling", "strip", "spot"];

export function isLamp({ kind }: Pick<HomeLamp, "kind">): boolean {
  return LAMP_KINDS.includes(kind);
}

/** Whether a search finds a lamp: by its name or its area. */
export function isFound({ label, id, area }: HomeLamp, search: string): boolean {
  const words = search.toLowerCase().split(/\s+/).filter(Boolean);
  const text = `${label || id} ${area}`.toLowerCase();
  return words.every((word) => text.includes(word));
}

/** Lamps by area, those without one last. */
export function byArea(lamps: readonly HomeLamp[]): [area: string, lamps: HomeLamp[]][] {
  const areas = new Map<string, HomeLamp[]>();
  for (const lamp of lamps) areas.set(lamp.area, [...(areas.get(lamp.area) ?? []), lamp]);
  return [...areas].sort(
    ([one], [other]) => Number(one === "") - Number(other === "") || one.localeCompare(other),
  );
}
