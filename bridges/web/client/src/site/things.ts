/** Things of the map: their states, who fired each last, and what of a person can be undone. */

import { capital, duration } from "../format";
import type { ActState, SelectionEvent, Thing, ThingState, TrackedObject } from "../messages";
import { isTooLate, listed, modeOf, objectOf, outcome, placeName } from "../words";
import { siteNow, type Person, type Site } from "./site";

/** Limit of objects whose changes are kept; the oldest are dropped. */
const MAX_CHANGES = 1000;
/** Younger changes are told without figures, s. */
const JUST_NOW_S = 2;

/** Keep the event, if it is a selection, a deselection or a refusal. */
export function noteChange({ changes }: Site, event: SelectionEvent): void {
  if (event.event !== "selected" && event.event !== "deselected" && event.event !== "refused") return;
  const before = changes.get(event.object_id);
  changes.delete(event.object_id);
  const last = event.event === "refused" ? {} : { last: event };
  changes.set(event.object_id, { ...before, [event.event]: event, ...last });
  if (changes.size > MAX_CHANGES) changes.delete(changes.keys().next().value!);
}

/** Whether `user` has selected something that they can clear: what a button fired ends by itself. */
export function hasSelected(site: Site, user: string): boolean {
  return (
    site.selection?.objects.some(
      (each) =>
        each.user === user && modeOf(site, each.id) !== "button" && !isTooLate(objectOf(site, each.id)),
    ) ?? false
  );
}

/** What is known of an act, and why it failed. */
export type KnownAct = Pick<ActState, "status" | "effect" | "text">;

/**
 * The act that the hover of `person` names: their last one on what they are on, since they came to it. Null: none.
 * The selector tells of it in another message, which may come later: until then it is no more than asked.
 */
export function lastAct(
  { selection }: Pick<Site, "selection">,
  { user, hover }: Pick<Person, "user" | "hover">,
): KnownAct | null {
  const actNs = hover?.act_ns ?? null; // old recordings have none
  if (actNs === null) return null;
  const told = selection?.acts?.find(
    (each) => each.object_id === hover!.object_id && each.user === user && each.asked_ns === actNs,
  );
  return told ?? { status: "asked", effect: "", text: "" };
}

/** The newest act on a thing that is not over, or null. */
export function runningAct({ selection }: Pick<Site, "selection">, id: string): ActState | null {
  const acts = selection?.acts?.filter((each) => each.object_id === id) ?? [];
  return acts.reverse().find(({ status }) => status === "asked" || status === "pending") ?? null;
}

/** What its carrier says of a thing that cannot be used, or null if it can. */
function closedState(site: Site, id: string): ThingState | null {
  for (const { things } of site.carriers.values()) {
    const thing = things.find((each) => each.id === id && each.state === "unavailable");
    if (thing) return thing;
  }
  return null;
}

/** Why the target of a thing is unavailable, with the remedy. Empty if it is not. */
export function unavailable(site: Site, id: string): string {
  const closed = closedState(site, id);
  return closed ? closed.reason || "its target does not answer" : "";
}

/** Whether the thing is unavailable only until the system that it belongs to has started. */
export function isStarting(site: Site, id: string): boolean {
  return closedState(site, id)?.is_starting ?? false;
}

/** Lamps of unavailable things: nobody knows whether they shine, so they are not drawn as lit. */
export function darkLamps(site: Pick<Site, "carriers" | "map">): ReadonlySet<string> {
  const closed = new Set<string>();
  for (const { things } of site.carriers.values())
    for (const { id, state } of things) if (state === "unavailable") closed.add(id);
  const lamps = closed.size
    ? (site.map?.things ?? []).filter(({ id }) => closed.has(id)).map(({ lamp }) => lamp)
    : [];
  return new Set(lamps.filter(Boolean));
}

/** A thing as its tile shows it. */
export interface ThingTile {
  readonly id: string;
  readonly name: string;
  readonly mode: Thing["mode"];
  /** Such as `Ready` or `On`. */
  readonly state: string;
  /** Why it is unavailable, with the remedy; "" if it is not. */
  readonly problem: string;
  /** It is unavailable only until the system that it belongs to has started. */
  readonly isStarting: boolean;
  readonly isOn: boolean;
  /** What pointing at it does. */
  readonly does: string;
  /** Who fired or switched it last and when, or that nobody did. */
  readonly last: string;
  /** How far a person has come with selecting it, 0 to 1; null if nobody points at it. */
  readonly progress: number | null;
  /** Whether it can be tried: buttons and switches that are in the room. */
  readonly canBeTried: boolean;
}

/** Tiles of all things, in the order of the map. */
export function thingTiles(site: Site): ThingTile[] {
  return (site.map?.things ?? []).map((thing) => tile(site, thing, objectOf(site, thing.id)));
}

/** Causes for which things are unavailable or starting, each once, with their names unless it is all of them. */
export function problemsOfThings(
  tiles: readonly Pick<ThingTile, "name" | "problem" | "isStarting">[],
): { text: string; isStarting: boolean }[] {
  const causes = new Set(tiles.map(({ problem }) => problem).filter(Boolean));
  return [...causes].map((cause) => {
    const those = tiles.filter(({ problem }) => problem === cause);
    const isStarting = those.every((each) => each.isStarting);
    const names =
      those.length === tiles.length && those.length > 1
        ? "Everything"
        : listed(those.map(({ name }) => name));
    return { text: `${names} ${isStarting ? "starting" : "unavailable"}: ${cause}`, isStarting };
  });
}

function tile(site: Site, thing: Thing, object: TrackedObject | null): ThingTile {
  const { id, mode } = thing;
  const selected = site.selection?.objects.find((each) => each.id === id);
  const owner = selected?.user ?? "";
  const reason = unavailable(site, id);
  const isUnderWay = selected?.is_pending || runningAct(site, id) !== null;
  const pointing = [...site.people.values()].filter(({ hover }) => hover?.object_id === id);
  const aims = pointing.map(({ user }) => user).join(", ");
  const states = {
    button: ["Fired", "Ready"],
    switch: ["On", "Off"],
    claim: [`Taken by ${owner}`, "Free"],
  } as const;
  const isComing = isStarting(site, id);
  const closed = isComing ? "Starting …" : "Unavailable";
  const state = !object
    ? "Not in the room now"
    : reason
      ? closed
      : isUnderWay
        ? "Under way …"
        : states[mode][owner ? 0 : 1];
  return {
    id,
    mode,
    name: capital(object?.kind || thing.label || placeName(id, "thing")),
    isOn: owner !== "" && !isUnderWay && !reason,
    problem: object ? reason : "",
    isStarting: object !== null && isComing,
    does: effect(
      thing,
      [...site.people.values()].some(({ announced }) => announced),
    ),
    last: lastChange(site, thing),
    state:
      object && aims && !owner && !reason
        ? `${state}: ${aims} ${pointing.length === 1 ? "points" : "point"} at it`
        : state,
    progress: pointing.length ? Math.max(...pointing.map(({ hover }) => hover!.progress)) : null,
    canBeTried: object !== null && mode !== "claim",
  };
}

function effect({ mode, press, dwell_s: dwell }: Thing, hasNames: boolean): string {
  const when = hasNames
    ? "on a press, once its name is heard"
    : press
      ? "on a press while somebody points at it"
      : dwell
        ? `when somebody stays on it for ${dwell} s`
        : "when somebody stays on it";
  return `${{ button: "Fires", switch: "Switches", claim: "Is taken, and given back," }[mode]} ${when}.`;
}

function lastChange(site: Site, { id, mode }: Thing): string {
  const changes = site.changes.get(id);
  const last = mode === "button" ? changes?.selected : changes?.last;
  if (!last) return mode === "button" ? "Not fired yet." : "Not used yet.";
  const ago = (siteNow(site) - last.stamp_ns) / 1e9 / (site.speed || 1);
  return `${outcome(site, last)} by ${last.user || "nobody"} ${ago < JUST_NOW_S ? "just now" : `${duration(ago)} ago`}.`;
}
