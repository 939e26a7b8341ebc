/** What the page calls things. */

import { capital } from "./format";
import { isBox } from "./geometry/appearance";
import type { Interaction, SelectionEvent, TrackedObject, UserPose } from "./messages";
import type { LogLine, Person, Site } from "./site/site";

/** Names in one sentence; one more is not worth a count. */
const MOST_NAMES = 3;

const STATES: Record<Interaction["state"], string> = {
  idle: "Not pointing",
  localizing: "Finding your place",
  pointing: "Pointing",
};

export function stateTitle(state: Interaction["state"]): string {
  return STATES[state] ?? capital(state);
}

const PRESSES: Record<Interaction["press"], string> = {
  "": "",
  start: "Start pointing",
  cancel: "Stop localizing",
  stop: "Stop pointing",
  confirm: "Confirm",
};

/** Effect of the button at the wrist now, or "" if it has none. */
export function pressTitle(interaction: Pick<Interaction, "press"> | null): string {
  return PRESSES[interaction?.press ?? "start"] ?? "Press the button";
}

/** ` For the kettle, press the button.`, if some things want a press where others do not. */
export function pressedSentence({ manner }: Pick<Site, "manner">): string {
  if (!manner?.pressed?.length) return "";
  const more = manner.pressed_count - manner.pressed.length;
  return ` For ${[...manner.pressed, ...(more > 0 ? [`${more} more`] : [])].join(", ")}, press the button.`;
}

/** The next step of a person, as their supervisor says. */
export function nextStepOf(site: Site, { interaction }: Pick<Person, "interaction">): string {
  return friendly(site, interaction?.next_step ?? "");
}

/** Sentence on the elevation bias that earlier localizations told, or "" if `pose` remembers none. */
export function rememberedSentence(pose: Pick<UserPose, "remembered_bias"> | null): string {
  const count = pose?.remembered_bias?.localizations ?? 0; // none in old recordings
  return count > 0
    ? `The elevation bias of ${count} localization${count > 1 ? "s" : ""} by a robot is remembered.`
    : "";
}

/** A tracked object by its id, of any tracker. */
export function objectOf(site: Site, id: string): TrackedObject | null {
  for (const { objects } of site.objects.values()) {
    const found = objects.find((object) => object.id === id);
    if (found) return found;
  }
  return null;
}

/** Whether it is on its last way, and selecting it or taking it back changes nothing any more. */
export function isTooLate(object: TrackedObject | null): boolean {
  return Boolean(object?.bay) && object!.bay_until_ns === 0;
}

/** Effect of selecting the object. */
export function modeOf(site: Site, id: string): TrackedObject["mode"] {
  return objectOf(site, id)?.mode ?? "claim";
}

/** Number of objects that are `user`'s own, of those that are `counted`: buttons and switches are nobody's. */
export function ownCount(site: Site, user: string, counted: (id: string) => boolean = () => true): number {
  return (
    site.selection?.objects.filter(
      (each) =>
        each.user === user && !each.is_pending && modeOf(site, each.id) === "claim" && counted(each.id),
    ).length ?? 0
  );
}

/** Whether the object is one of the map's things, which have names of their own. */
export function isNamed(site: Site, id: string): boolean {
  const object = objectOf(site, id);
  return object !== null && isBox(object);
}

/** Name of something of the map, shown to people: `led_2` of a lamp is `lamp 2`, `behind_left` is `behind left`. */
export function placeName(id: string, noun: string): string {
  const number = /^(?:led|lamp|strip|box)?[_\- ]?(\d+)$/i.exec(id)?.[1];
  return number === undefined ? id.replace(/[_-]+/g, " ").trim() || id : `${noun} ${number}`;
}

/** A sentence of a service with the names of lamps and strips as they are shown. */
export function friendly({ map }: Pick<Site, "map">, sentence: string): string {
  const ids = (all: readonly { id: string }[] = []): string[] => all.map(({ id }) => id);
  return withNames(withNames(sentence, ids(map?.lamps)), ids(map?.strips), "strip");
}

/** A sentence with the names of `places` instead of their ids: `lamp led_2` is `lamp 2`, too. Numbers stay: they may mean anything. */
export function withNames(
  sentence: string,
  places: readonly string[],
  noun: "lamp" | "strip" = "lamp",
): string {
  return places.reduce((text, id) => {
    const shown = placeName(id, noun);
    const before = shown.startsWith(`${noun} `) ? `(?:${noun} )?` : "";
    if (shown === id || /^\d+$/.test(id) || !text.includes(id)) return text;
    return text.replace(
      new RegExp(`(?<![\\w-])${before}${id.replace(/[^\w]/g, "\\$&")}(?![\\w-])`, "gi"),
      shown,
    );
  }, sentence);
}

/** What runs on the conveyor. */
export function nounOf(site: Site): "segment" | "package" {
  return site.map?.belts.length === 0 ? "segment" : "package";
}

/** What moves them, and can be stopped. */
export function movingOf(site: Site): "segments" | "belts" {
  return nounOf(site) === "segment" ? "segments" : "belts";
}

/** `red package`, `blue segment`, `screws`. */
export function thing(site: Site, id: string, kind = ""): string {
  const object = objectOf(site, id);
  if (object && isBox(object)) return object.kind || id;
  const noun =
    object?.surface === "strip"
      ? "segment"
      : object?.surface === "belt"
        ? "package"
        : site.conveyor
          ? nounOf(site)
          : "object";
  return [kind || object?.kind, noun].filter(Boolean).join(" ");
}

/** End of an id; its beginning distinguishes runs of PointIt. */
function ending(id: string): string {
  return id.slice(id.lastIndexOf("-") + 1);
}

/** An object among others: `red 24`. */
export function called(site: Site, id: string, kind = ""): string {
  if (isNamed(site, id)) return thing(site, id);
  return `${kind || objectOf(site, id)?.kind || thing(site, id)} ${ending(id)}`;
}

/** Names in a sentence: `red 24, red 25 and 3 more`. */
export function listed(names: readonly string[]): string {
  const more = names.length - MOST_NAMES;
  return more > 1 ? `${names.slice(0, MOST_NAMES).join(", ")} and ${more} more` : names.join(", ");
}

export const OUTCOMES = {
  claim: ["Selected", "Taken back"],
  button: ["Fired", ""],
  switch: ["Switched on", "Switched off"],
} as const;

/** Name of a selection or its end, by the object's mode; "" if there is nothing to tell. One that runs for long has only started. */
export function outcome(site: Site, { object_id: id, event, status }: SelectionEvent): string {
  if (status === "pending") return "Started";
  return OUTCOMES[modeOf(site, id)][event === "selected" ? 0 : 1];
}

/** Text of a selection event in the log. */
export function eventLine(
  site: Site,
  event: SelectionEvent,
): { severity: LogLine["severity"]; text: string } {
  const what = called(site, event.object_id, event.kind);
  const why = event.reason ? `: ${event.reason}` : "";
  if (isNamed(site, event.object_id) && (event.event === "selected" || event.event === "deselected")) {
    return {
      severity: "info",
      text: `${what}: ${outcome(site, event).toLowerCase() || "ready again"}${why}`,
    };
  }
  switch (event.event) {
    case "selected":
      return { severity: "info", text: `selected ${what}` };
    case "deselected":
      return { severity: "info", text: `took back ${what}${why}` };
    case "refused":
      return { severity: "warning", text: `could not change ${what}${why}` };
    case "dispatched":
      return { severity: "info", text: `${what} left at bay ${event.bay}` };
    case "left":
      return { severity: "info", text: `${what} left` };
    default:
      return { severity: "info", text: `${String(event.event)} ${what}` };
  }
}
