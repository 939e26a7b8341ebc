/** The plan as text: one short line per person, object and lamp. */

import { robotLine, seenRobots } from "../site/robots";
import { holdersOf, ownersOf, standingOf, thingsOf, type Person, type Site } from "../site/site";
import { darkLamps, runningAct } from "../site/things";
import type { TrackedObject } from "../messages";
import { byName } from "../format";
import { isBox } from "../geometry/appearance";
import { isTooLate, placeName, stateTitle, thing } from "../words";

export interface Row {
  key: string;
  name: string;
  text: string;
}

/** Selected or not, in words, by the effect of selecting. */
const STATES = {
  claim: ["selected", "not selected"],
  button: ["fired", "ready"],
  switch: ["switched on", "off"],
} as const;

/** People in counting order: activity and target. */
export function peopleRows(site: Site): Row[] {
  return [...site.people.values()]
    .sort((a, b) => byName(a.user, b.user))
    .map((person) => ({
      key: person.user,
      name: person.user,
      text: [whatTheyDo(person), ...whereTheyStand(person), ...whatTheyPointAt(site, person)].join("; "),
    }));
}

/** Robots: who steers each, what it does, and why not. */
export function robotRows(site: Site): Row[] {
  return seenRobots(site).map(({ name, state }) => ({
    key: name,
    name,
    text: [robotLine(state), state.reason].filter(Boolean).join("; "),
  }));
}

/** Objects with their owners. */
export function objectRows(site: Site): (Row & { object: TrackedObject })[] {
  const owners = ownersOf(site);
  const holders = holdersOf(site);
  const all = thingsOf(site).map(({ object }) => object);
  const short = shortNames(all.map(({ id }) => id));
  return all
    .sort((a, b) => byName(a.id, b.id))
    .map((object) => {
      const owner = owners.get(object.id);
      const holder = holders.get(object.id);
      const [on, off] = STATES[object.mode];
      const isUnderWay = runningAct(site, object.id) !== null;
      const state = isUnderWay
        ? "under way"
        : owner
          ? `${on} by ${owner}`
          : holder
            ? `${holder} is about to select it`
            : off;
      return {
        key: object.id,
        name: isBox(object) ? thing(site, object.id) : `${thing(site, object.id)} ${short.get(object.id)!}`,
        text: `${whereItIs(object)}; ${state}`,
        object,
      };
    });
}

/** Lamps: whether they shine, and who is to point at them. */
export function lampRows(site: Site): (Row & { at: [number, number, number] })[] {
  const wanted = new Map<string, string[]>();
  for (const { user, localization } of site.people.values()) {
    if (localization?.phase !== "sampling" || !localization.target_id) continue;
    wanted.set(localization.target_id, [...(wanted.get(localization.target_id) ?? []), user]);
  }
  const dark = darkLamps(site);
  return (site.map?.lamps ?? []).map((lamp) => {
    const isLit = !dark.has(lamp.id) && (site.lamps.get(lamp.id)?.color.some((part) => part > 0) ?? false);
    const who = wanted.get(lamp.id);
    return {
      key: lamp.id,
      name: placeName(lamp.id, "lamp"),
      at: [...lamp.position_m],
      text: [isLit ? "lit" : "dark", ...(who ? [`${who.join(", ")} is to point at it`] : [])].join("; "),
    };
  });
}

/** Ends of ids, if unique, as short names: `…14-3` is `3`. */
export function shortNames(ids: readonly string[]): Map<string, string> {
  const parts = (id: string) => /^(.*-)(\d+)$/.exec(id);
  const endings = new Map(ids.map((id) => [id, parts(id)?.[2] ?? id]));
  const isClear = new Set(endings.values()).size === new Set(ids).size;
  return isClear ? endings : new Map(ids.map((id) => [id, id]));
}

function whatTheyDo(person: Person): string {
  const state = person.interaction ? stateTitle(person.interaction.state).toLowerCase() : "nothing heard yet";
  const search = person.localization;
  const isSearching =
    person.interaction?.state === "localizing" && search?.phase === "sampling" && search.target_id;
  return isSearching
    ? `${state}, pointing at ${placeName(search.target_id, "lamp")}, ${Math.round(search.progress * 100)} %`
    : state;
}

function whereTheyStand(person: Person): string[] {
  const stands = standingOf(person);
  return !stands
    ? ["their position is not known"]
    : stands.isAssumed
      ? ["their position is not yet measured"]
      : [];
}

function whatTheyPointAt(site: Site, person: Person): string[] {
  const hover = person.hover;
  if (hover?.object_id) {
    const progress = hover.action ? `, ${hover.action} ${Math.round(hover.progress * 100)} %` : "";
    return [`points at ${thing(site, hover.object_id)}${progress}`];
  }
  const cursor = person.cursor;
  if (cursor && cursor.surface !== "none") return [`points at ${placed(cursor.surface, cursor.surface_id)}`];
  return cursor?.solid ? [`points at ${placed(cursor.solid, cursor.surface_id)}`] : [];
}

/** A surface with its name: `strip 3`, `belt main`. */
function placed(noun: string, id: string): string {
  const name = placeName(id, noun);
  return name.startsWith(noun) ? name : `${noun} ${name}`;
}

function whereItIs(object: TrackedObject): string {
  const to = object.bay
    ? `, bound for bay ${object.bay}${isTooLate(object) ? ", too late to change" : ""}`
    : "";
  if (object.surface === "belt" || object.surface === "strip") {
    return `on ${placed(object.surface, object.surface_id)} at ${object.surface_position_m.toFixed(1)} m${to}`;
  }
  const [x, y] = object.position_m;
  return `at ${x.toFixed(1)}, ${y.toFixed(1)} m${to}`;
}
