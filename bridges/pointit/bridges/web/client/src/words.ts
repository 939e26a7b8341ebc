/** What the page calls things. */

import { capital } from "./format";
import { isBox } from "./geometry/looks";
import type { Interaction, SelectionEvent, TrackedObject } from "./messages";
import type { LogLine, Site } from "./site/site";

/** Titles of scenarios; others are shown by their names. */
const SCENARIOS: Record<string, string> = {
  scenario_1: "Lamps: point at them",
  scenario_2: "Strips: move the cursor",
  scenario_3: "Strips: select the red segments",
  scenario_4: "Conveyor: select the red packages",
  scenario_5: "Quadrotor: fly it by pointing",
  scenario_6: "Ground robot: send it by pointing",
};

export function scenarioTitle(name: string): string {
  return SCENARIOS[name] ?? capital(name.replaceAll("_", " "));
}

const STATES: Record<Interaction["state"], string> = {
  idle: "Not pointing", localizing: "Finding your place", pointing: "Pointing",
};

export function stateTitle(state: Interaction["state"]): string {
  return STATES[state] ?? capital(state);
}

/** Effect of the button at the wrist now; the supervisor's next step tells what a press does while somebody points. */
export function pressTitle(interaction: Pick<Interaction, "state" | "next_step"> | null): string {
  if (!interaction || interaction.state === "idle") return "Start pointing";
  if (interaction.state === "localizing") return "Stop localizing";
  if (/button to stop\b/.test(interaction.next_step)) return "Stop pointing";
  return /button to confirm\b/.test(interaction.next_step) ? "Confirm" : "Press the button";
}

/** A tracked object by its id, of any tracker. */
export function objectOf(site: Site, id: string): TrackedObject | null {
  for (const { objects } of site.objects.values()) {
    const found = objects.find((object) => object.id === id);
    if (found) return found;
  }
  return null;
}

/** Effect of selecting the object. */
export function modeOf(site: Site, id: string): TrackedObject["mode"] {
  return objectOf(site, id)?.mode ?? "claim";
}

/** Number of objects that are `user`'s own: buttons and switches are nobody's. */
export function ownCount(site: Site, user: string): number {
  return site.selection?.objects.filter((each) => each.user === user && modeOf(site, each.id) === "claim").length ?? 0;
}

/** Whether the object is one of the map's things, which have names of their own. */
export function isNamed(site: Site, id: string): boolean {
  const object = objectOf(site, id);
  return object !== null && isBox(object);
}

/** `red package`, `blue segment`, `screws`. */
export function thing(site: Site, id: string, kind = ""): string {
  const object = objectOf(site, id);
  if (object && isBox(object)) return object.kind || id;
  const noun = object?.surface === "strip" ? "segment" : object?.surface === "belt" || site.conveyor ? "package" : "object";
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

/** Reason of an event of an object, with its id as shown to people, or "" if there is none. */
export function plainly({ object_id: id, reason }: SelectionEvent): string {
  return id ? reason.replaceAll(id, ending(id)) : reason;
}

const OUTCOMES = { claim: ["Selected", "Taken back"], button: ["Fired", ""], switch: ["Switched on", "Switched off"] } as const;

/** Name of a selection or its end, by the object's mode; "" if there is nothing to tell. */
export function outcome(site: Site, { object_id: id, event }: SelectionEvent): string {
  return OUTCOMES[modeOf(site, id)][event === "selected" ? 0 : 1];
}

/** Text of a selection event in the log. */
export function eventLine(site: Site, event: SelectionEvent): { severity: LogLine["severity"]; text: string } {
  const what = called(site, event.object_id, event.kind);
  const why = event.reason ? `: ${plainly(event)}` : "";
  if (isNamed(site, event.object_id) && (event.event === "selected" || event.event === "deselected")) {
    return { severity: "info", text: `${what}: ${outcome(site, event).toLowerCase() || "ready again"}${why}` };
  }
  switch (event.event) {
    case "selected": return { severity: "info", text: `selected ${what}` };
    case "deselected": return { severity: "info", text: `took back ${what}${why}` };
    case "refused": return { severity: "warning", text: `could not change ${what}${why}` };
    case "dispatched": return { severity: "info", text: `${what} left at bay ${event.bay}` };
    case "left": return { severity: "info", text: `${what} left` };
    default: return { severity: "info", text: `${String(event.event)} ${what}` };
  }
}
