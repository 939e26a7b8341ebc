/** What the card's table is asked with: the site as facts, and the words of its templates. */

import type { Controls } from "./controls";
import { capital } from "./format";
import type { Facts, Words } from "./guidance";
import { emptySentence, passedSentence } from "./run";
import { proposalOf, thingsOf, type Person, type Site } from "./site/site";
import { isStarting, lastAct, unavailable, type KnownAct } from "./site/things";
import { friendly, modeOf, nextStepOf, objectOf, ownCount, pressedSentence, thing } from "./words";

/** What this person selected a moment ago. */
export interface Success {
  readonly did: string;
  readonly isWrong: boolean;
}

/** The facts about `person`, and the words for them; `success`: null if the last one is some seconds ago. */
export function factsOf(
  controls: Controls,
  person: Person,
  steers: boolean,
  success: Success | null,
): { facts: Facts; words: Words } {
  const { site } = controls;
  const { user, hover, line } = person;
  const id = hover?.object_id ?? "";
  const object = objectOf(site, id);
  const act = lastAct(site, person);
  const closed = unavailable(site, id);
  const other = hover?.taken_by ?? "";
  const does = hover?.action ?? "";
  const owned = site.selection?.objects.find((each) => each.id === id);
  const passed = passedSentence(site, controls);
  const empty = emptySentence(site);
  const mine = line?.is_mine && line.moved_by === "mouse";
  const facts: Facts = {
    isOver: passed !== "",
    who: mine ? "me" : !line || line.moved_by === "own" ? WHO[line?.source ?? "device"] : line.moved_by,
    mayTake: controls.mayDo("take") || controls.mayDo("pair"),
    state: person.interaction?.state ?? "pointing",
    just: !success ? "" : success.isWrong ? "wrong" : "right",
    isOnThing: id !== "",
    last: act && isInForce(act, modeOf(site, id), owned !== undefined) ? act.status : "",
    barrier:
      other && does === "refuse"
        ? "taken"
        : closed
          ? isStarting(site, id)
            ? "starting"
            : "unavailable"
          : does === "refuse"
            ? "late"
            : owned?.is_pending
              ? "pending"
              : does === "select" && !controls.isWanted(object?.kind ?? "")
                ? "unwanted"
                : "",
    does,
    mode: modeOf(site, id),
    by: selectsBy(site, person),
    owner: owned?.user === user ? (controls.hasSelected(id) ? "page" : "person") : owned ? "other" : "",
    steers,
    isProposed: proposalOf(person) !== null,
    isEmpty: empty !== "",
    canSelect: controls.isPresent("selector"),
    hasGoal: controls.goal !== "",
    isAdvised: person.interaction?.is_advised ?? false,
  };
  const count = ownCount(site, user, (each) => controls.hasSelected(each));
  const named = capital(thing(site, id));
  return {
    facts,
    words: {
      user,
      thing: named,
      other,
      goal: controls.goal,
      next: nextStepOf(site, person),
      passed,
      empty,
      pressed: pressedSentence(site),
      why:
        facts.last === "failed" || facts.last === "unanswered"
          ? friendly(site, act?.text ?? "") || "it could not be selected"
          : closed,
      did: success?.did ?? "",
      count: count > 1 ? `${count} are yours now. ` : "",
      wanted: `the ${controls.targetKinds.join(" or ")} ones`,
    },
  };
}

/** Whether the thing is as the act left it; it may have been changed since, by others or at its place. */
function isInForce({ status, effect }: KnownAct, mode: Facts["mode"], isSelected: boolean): boolean {
  return status !== "done" || mode === "button" || (effect === "select") === isSelected;
}

const WHO = { unknown: "unknown", none: "nobody", device: "device", simulation: "simulation" } as const;

/** What selects the thing that they are on, or things here. */
function selectsBy(site: Site, { announced, hover }: Person): Facts["by"] {
  if (announced) return site.manner?.names_by === "stay" ? "stay" : "name";
  const object = objectOf(site, hover?.object_id ?? "");
  const objects = thingsOf(site);
  const isPressed = object ? object.press : objects.length > 0 && objects.every((each) => each.object.press);
  return isPressed ? "press" : (site.manner?.by ?? "stay");
}
