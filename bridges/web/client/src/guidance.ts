/**
 * Guidance for new users over the scene, from one table: who has the arm, what they point at, what came of their last act.
 * The first row that fits is shown. It has no names of scenarios: what there is to do is stated by the site.
 */

import type { ActState, Hover, Interaction, SelectionManner, TrackedObject } from "./messages";

/** What there is to do: point at something, stay on it, leave it before it is full, press; or it does what was asked, or cannot. */
export type Step = "aim" | "hold" | "leave" | "press" | "following" | "stopped";
export type Mode = "none" | "invite" | "other" | "idle" | "point" | "success" | "wrong" | "phone" | "passed";
export type Offer = "take" | "pair" | "press" | "again" | "give";

/** Everything on which the choice of a row depends. */
export interface Facts {
  /** All packages have passed. */
  isOver: boolean;
  /** Who has the person's arm: this page, not known yet, nobody, their own device, a simulated person, another page … */
  who: "me" | "unknown" | "nobody" | "device" | "simulation" | "mouse" | "phone" | "headset";
  /** This page may take an arm, or pair a phone. */
  mayTake: boolean;
  state: Interaction["state"];
  /** What this person selected a moment ago was to be selected, or not. */
  just: "" | "right" | "wrong";
  isOnThing: boolean;
  /** State of their last act on it since they came to it; "" if there is none, or it was changed since. */
  last: "" | ActState["status"];
  /** Reason why an act on it would fail, or should not be. */
  barrier: "" | "unavailable" | "starting" | "taken" | "late" | "pending" | "unwanted";
  /** Effect of staying on it, or of a press. */
  does: Hover["action"];
  mode: TrackedObject["mode"];
  /** It is selected: by nobody, this page, this person otherwise, somebody else. */
  owner: "" | "page" | "person" | "other";
  /** What selects it; where nothing is pointed at, what selects here. */
  by: SelectionManner["by"] | "name";
  /** The person steers robots or may; a place for one is proposed; nothing is left to select, for a reason. */
  steers: boolean;
  isProposed: boolean;
  isEmpty: boolean;
  /** Objects can be selected here; the site says what there is to do. */
  canSelect: boolean;
  hasGoal: boolean;
  /** A service that acts on what the person does has told their next step. */
  isAdvised: boolean;
}

/** Words that fill the table's templates. */
export interface Words {
  user: string;
  thing: string;
  other: string;
  /** Reason of a barrier or a refusal, with the remedy. */
  why: string;
  goal: string;
  /** The next step, as the person's supervisor says. */
  next: string;
  /** Last selection, such as `fired the kettle`; how many are theirs now. */
  did: string;
  count: string;
  /** Kinds to select. */
  wanted: string;
  passed: string;
  empty: string;
  /** ` For the kettle, press the button.`, or nothing. */
  pressed: string;
}

export interface Said {
  readonly mode: Mode;
  readonly step: Step;
  readonly title: string;
  readonly text: string;
  /** Label of the button that acts as a press at the wrist. Empty if it is hidden. */
  readonly press: string;
  readonly offers: readonly Offer[];
}

export interface Row {
  readonly name: string;
  readonly when: { readonly [K in keyof Facts]?: Facts[K] | readonly Facts[K][] };
  readonly say: Said;
}

const MINE = {
  mode: "point",
  step: "aim",
  title: "You are the arm now.",
  text: "",
  press: "",
  offers: ["give"],
} as const;
const ON = { isOnThing: true, canSelect: true } as const;
const THEIRS = ["page", "person"] as const;
const SELECTED = ["page", "person", "other"] as const;
const row = (name: string, when: Row["when"], say: Partial<Said>): Row => ({
  name,
  when,
  say: { ...MINE, ...say },
});

export const TABLE: readonly Row[] = [
  row("all have passed", { isOver: true }, { mode: "passed", title: "{passed}", offers: ["again"] }),

  row("not known yet", { who: "unknown" }, { mode: "none", title: "", offers: [] }),
  row(
    "who only looks on",
    { who: ["nobody", "device", "simulation", "mouse"], mayTake: false },
    { mode: "none", title: "", offers: [] },
  ),
  row(
    "nobody",
    { who: "nobody" },
    { mode: "invite", title: "Nobody points as {user} yet. Do it yourself:", offers: ["take", "pair"] },
  ),
  row(
    "a simulated person",
    { who: "simulation" },
    { mode: "invite", title: "This is a simulation. Take over:", offers: ["take", "pair"] },
  ),
  row(
    "another page",
    { who: "mouse" },
    { mode: "other", title: "Another page points as {user}. Take over:", offers: ["take"] },
  ),
  row("a phone", { who: "phone" }, { mode: "phone", title: "A phone points.", text: "{next}" }),
  row("a headset", { who: "headset" }, { mode: "phone", title: "A headset points.", text: "{next}" }),
  row(
    "their own device",
    { who: "device" },
    { mode: "other", title: "{user} points with their own device.", text: "{next}", offers: ["take"] },
  ),

  row(
    "rests",
    { state: "idle" },
    {
      mode: "idle",
      step: "press",
      title: "Your arm rests.",
      text: "{next}",
      press: "Start pointing",
      offers: ["press", "give"],
    },
  ),
  row(
    "is found",
    { state: "localizing" },
    { title: "You are the arm. First, PointIt finds your position.", text: "{next}" },
  ),
  row(
    "selected what is not wanted",
    { just: "wrong" },
    {
      mode: "wrong",
      title: "You {did}, which should not be selected.",
      text: "Select it again to take it back.",
    },
  ),
  row(
    "selected",
    { just: "right" },
    { mode: "success", title: "You {did}!", text: "{count}Continue with the next one." },
  ),

  row("failed", { ...ON, last: "failed" }, { step: "stopped", text: "{thing} did not change: {why}" }),
  row(
    "unanswered",
    { ...ON, last: "unanswered" },
    { step: "stopped", text: "{thing} did not answer: {why}" },
  ),
  row("asked", { ...ON, last: "asked" }, { step: "following", text: "{thing}: in progress …" }),
  row(
    "started",
    { ...ON, last: "pending" },
    { step: "following", text: "{thing} has started; its result follows." },
  ),
  row(
    "unavailable",
    { ...ON, barrier: "unavailable" },
    { step: "stopped", text: "{thing} is unavailable: {why}" },
  ),
  row("starting", { ...ON, barrier: "starting" }, { step: "following", text: "{thing} is starting: {why}" }),
  row(
    "another's",
    { ...ON, barrier: "taken", mode: "claim" },
    { step: "stopped", text: "{thing} is taken: {other} has it. Point at another one, or wait." },
  ),
  row(
    "in use",
    { ...ON, barrier: "taken" },
    {
      step: "stopped",
      text: "{thing} is busy: {other} is about to use it. Point at another one, or wait.",
    },
  ),
  row(
    "too late",
    { ...ON, barrier: "late" },
    { step: "stopped", text: "{thing} cannot be selected any more. Point at another one." },
  ),
  row("under way", { ...ON, barrier: "pending" }, { step: "following", text: "{thing}: in progress …" }),
  row(
    "not wanted; stay selects it",
    { ...ON, barrier: "unwanted", by: "stay" },
    {
      step: "leave",
      text: "{thing} should not be selected, but staying on it selects it. Move on to {wanted}.",
    },
  ),
  row(
    "not wanted",
    { ...ON, barrier: "unwanted" },
    { text: "{thing} should not be selected. Move on to {wanted}." },
  ),

  row(
    "not told yet",
    { ...ON, does: "deselect", owner: "" },
    { step: "following", text: "{thing}: in progress …" },
  ),
  row(
    "on; stay ends it",
    { ...ON, does: "deselect", mode: "switch", owner: SELECTED, by: "stay" },
    { step: "hold", text: "{thing} is on; staying switches it off." },
  ),
  row(
    "on; press ends it",
    { ...ON, does: "deselect", mode: "switch", owner: SELECTED },
    press("{thing} is on; the button switches it off."),
  ),
  row(
    "left by another; stay ends it",
    { ...ON, does: "deselect", owner: "other", by: "stay" },
    { step: "hold", text: "{thing} belongs to somebody who has gone; staying frees it." },
  ),
  row(
    "left by another; press ends it",
    { ...ON, does: "deselect", owner: "other" },
    press("{thing} belongs to somebody who has gone; the button frees it."),
  ),
  row(
    "theirs; stay ends it",
    { ...ON, does: "deselect", owner: THEIRS, by: "stay" },
    { step: "hold", text: "{thing} is yours; staying takes it back." },
  ),
  row(
    "theirs; press ends it",
    { ...ON, does: "deselect", owner: THEIRS },
    press("{thing} is yours; the button takes it back."),
  ),

  row(
    "fired",
    { ...ON, mode: "button", last: "done" },
    { step: "following", text: "{thing} has fired. Continue with the next one." },
  ),
  row(
    "is on",
    { ...ON, mode: "switch", owner: SELECTED, does: "", last: "done" },
    { step: "following", text: "{thing} is on. Continue with the next one." },
  ),
  row(
    "is off",
    { ...ON, mode: "switch", owner: "", does: "", last: "done" },
    { step: "following", text: "{thing} is off. Continue with the next one." },
  ),
  row(
    "theirs, by this page",
    { ...ON, mode: "claim", owner: "page", last: "done" },
    { step: "following", text: "{thing} is yours. Continue with the next one." },
  ),
  row(
    "theirs, otherwise",
    { ...ON, mode: "claim", owner: THEIRS },
    { step: "following", text: "{thing} is selected already. Point at another one." },
  ),
  row(
    "belongs to another",
    { ...ON, mode: "claim", owner: "other", does: "" },
    { step: "following", text: "{thing} belongs to {other}. Point at another one." },
  ),
  row(
    "free again",
    { ...ON, mode: "claim", owner: "", does: "", last: "done" },
    { step: "following", text: "{thing} is free again. Continue with the next one." },
  ),
  row(
    "was not left yet",
    { ...ON, does: "" },
    { step: "following", text: "{thing}: leave it, then point at it again." },
  ),

  row("by its name", { ...ON, by: "name" }, press("{thing}: press once you have heard its name.")),
  row("by a press", { ...ON, by: "press" }, press("{thing}: press the button.")),
  row("by staying", { ...ON }, { step: "hold", text: "{thing}: stay on it …" }),

  row("robots", { steers: true }, {}),
  row("empty", { isEmpty: true }, { step: "stopped", text: "{empty}" }),
  row(
    "a place is proposed",
    { isProposed: true },
    { step: "hold", text: "This position is proposed. Point elsewhere, then here again to confirm it." },
  ),
  row(
    "names are spoken",
    { canSelect: true, by: "name" },
    {
      text: "Point at things, or step by the arrow keys: their names are spoken. Press once you have heard the one that you want.",
    },
  ),
  row("advised by a service", { isAdvised: true }, { text: "{next}" }),
  row("the site's goal", { hasGoal: true }, { text: "{goal}{pressed}" }),
  row(
    "all want a press",
    { canSelect: true, by: "press" },
    { text: "Move onto a thing and press the button." },
  ),
  row(
    "staying selects",
    { canSelect: true },
    { text: "Move onto a thing and stay on it until it is full.{pressed}" },
  ),
  row("nothing to select", {}, { text: "Point anywhere: the arm follows you." }),
];

function press(text: string): Partial<Said> {
  return { step: "press", text, press: "Press", offers: ["press", "give"] };
}

/** Whether the row is that of `facts`, if no one before it is. */
function fits({ when }: Row, facts: Facts): boolean {
  return (Object.keys(when) as (keyof Facts)[]).every((each) => {
    const wanted = when[each];
    return Array.isArray(wanted) ? (wanted as unknown[]).includes(facts[each]) : wanted === facts[each];
  });
}

/** The row of the table for `facts`. */
export function rowOf(facts: Facts): Row {
  return TABLE.find((each) => fits(each, facts))!;
}

/** What the card says. */
export function guidance(facts: Facts, words: Words): Said {
  const { say } = rowOf(facts);
  const filled = (template: string): string =>
    template.replace(/\{(\w+)\}/g, (_, name: keyof Words) => words[name]);
  return { ...say, title: filled(say.title), text: filled(say.text) };
}
