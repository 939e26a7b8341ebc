// The card's table, row by row, and what must hold of it whatever the facts are.
import assert from "node:assert/strict";
import { test } from "node:test";
import { guidance, rowOf, TABLE, type Facts, type Words } from "./guidance";

const mine: Facts = {
  isOver: false,
  who: "me",
  mayTake: true,
  state: "pointing",
  just: "",
  isOnThing: false,
  last: "",
  barrier: "",
  does: "",
  mode: "button",
  owner: "",
  by: "stay",
  steers: false,
  isProposed: false,
  isEmpty: false,
  canSelect: true,
  hasGoal: false,
  isAdvised: false,
};
const words: Words = {
  user: "ada",
  thing: "The lamp",
  other: "ben",
  why: "it does not answer: start it",
  goal: "Point at a box.",
  next: "Wear the band.",
  did: "fired the lamp",
  count: "2 are yours now. ",
  wanted: "the red ones",
  passed: "All packages have passed.",
  empty: "No package is here.",
  pressed: " For the kettle, press the button.",
};
const on: Partial<Facts> = { isOnThing: true, does: "select" };

/** Of each row: facts that lead to it, and what it says. */
const CASES: readonly [row: string, facts: Partial<Facts>, said: string][] = [
  ["all have passed", { isOver: true, who: "simulation" }, "All packages have passed."],
  ["not known yet", { who: "unknown" }, ""],
  ["who only looks on", { who: "nobody", mayTake: false }, ""],
  ["nobody", { who: "nobody", state: "idle" }, "Nobody points as ada yet. Do it yourself:"],
  ["a simulated person", { who: "simulation" }, "This is a simulation. Take over:"],
  ["another page", { who: "mouse" }, "Another page points as ada. Take over:"],
  ["a phone", { who: "phone" }, "A phone points. Wear the band."],
  ["a headset", { who: "headset" }, "A headset points. Wear the band."],
  ["their own device", { who: "device" }, "ada points with their own device. Wear the band."],
  ["rests", { state: "idle" }, "Your arm rests. Wear the band."],
  [
    "is found",
    { state: "localizing" },
    "You are the arm. First, PointIt finds your position. Wear the band.",
  ],
  [
    "selected what is not wanted",
    { just: "wrong" },
    "You fired the lamp, which should not be selected. Select it again to take it back.",
  ],
  ["selected", { just: "right" }, "You fired the lamp! 2 are yours now. Continue with the next one."],
  ["failed", { ...on, last: "failed", does: "" }, "The lamp did not change: it does not answer: start it"],
  ["unanswered", { ...on, last: "unanswered" }, "The lamp did not answer: it does not answer: start it"],
  ["asked", { ...on, last: "asked", does: "" }, "The lamp: in progress …"],
  ["started", { ...on, last: "pending", does: "" }, "The lamp has started; its result follows."],
  [
    "unavailable",
    { ...on, barrier: "unavailable", does: "refuse" },
    "The lamp is unavailable: it does not answer: start it",
  ],
  [
    "starting",
    { ...on, barrier: "starting", does: "refuse" },
    "The lamp is starting: it does not answer: start it",
  ],
  [
    "another's",
    { ...on, barrier: "taken", does: "refuse", mode: "claim" },
    "The lamp is taken: ben has it. Point at another one, or wait.",
  ],
  [
    "in use",
    { ...on, barrier: "taken", does: "refuse" },
    "The lamp is busy: ben is about to use it. Point at another one, or wait.",
  ],
  [
    "too late",
    { ...on, barrier: "late", does: "refuse", mode: "claim" },
    "The lamp cannot be selected any more. Point at another one.",
  ],
  ["under way", { ...on, barrier: "pending", does: "" }, "The lamp: in progress …"],
  [
    "not wanted; stay selects it",
    { ...on, barrier: "unwanted", mode: "claim" },
    "The lamp should not be selected, but staying on it selects it. Move on to the red ones.",
  ],
  [
    "not wanted",
    { ...on, barrier: "unwanted", mode: "claim", by: "press" },
    "The lamp should not be selected. Move on to the red ones.",
  ],
  ["not told yet", { ...on, does: "deselect", mode: "switch" }, "The lamp: in progress …"],
  [
    "on; stay ends it",
    { ...on, does: "deselect", mode: "switch", owner: "other" },
    "The lamp is on; staying switches it off.",
  ],
  [
    "on; press ends it",
    { ...on, does: "deselect", mode: "switch", owner: "person", by: "press" },
    "The lamp is on; the button switches it off.",
  ],
  [
    "left by another; stay ends it",
    { ...on, does: "deselect", mode: "claim", owner: "other" },
    "The lamp belongs to somebody who has gone; staying frees it.",
  ],
  [
    "left by another; press ends it",
    { ...on, does: "deselect", mode: "claim", owner: "other", by: "press" },
    "The lamp belongs to somebody who has gone; the button frees it.",
  ],
  [
    "theirs; stay ends it",
    { ...on, does: "deselect", mode: "claim", owner: "page" },
    "The lamp is yours; staying takes it back.",
  ],
  [
    "theirs; press ends it",
    { ...on, does: "deselect", mode: "claim", owner: "person", by: "press" },
    "The lamp is yours; the button takes it back.",
  ],
  ["fired", { ...on, does: "", last: "done" }, "The lamp has fired. Continue with the next one."],
  [
    "is on",
    { ...on, does: "", mode: "switch", owner: "page", last: "done" },
    "The lamp is on. Continue with the next one.",
  ],
  [
    "is off",
    { ...on, does: "", mode: "switch", last: "done" },
    "The lamp is off. Continue with the next one.",
  ],
  [
    "theirs, by this page",
    { ...on, mode: "claim", owner: "page", last: "done" },
    "The lamp is yours. Continue with the next one.",
  ],
  [
    "theirs, otherwise",
    { ...on, mode: "claim", owner: "person" },
    "The lamp is selected already. Point at another one.",
  ],
  [
    "belongs to another",
    { ...on, does: "", mode: "claim", owner: "other" },
    "The lamp belongs to ben. Point at another one.",
  ],
  [
    "free again",
    { ...on, does: "", mode: "claim", last: "done" },
    "The lamp is free again. Continue with the next one.",
  ],
  ["was not left yet", { ...on, does: "" }, "The lamp: leave it, then point at it again."],
  ["by its name", { ...on, by: "name" }, "The lamp: press once you have heard its name."],
  ["by a press", { ...on, by: "press" }, "The lamp: press the button."],
  ["by staying", on, "The lamp: stay on it …"],
  ["robots", { steers: true, isOnThing: true, canSelect: false }, ""],
  ["empty", { isEmpty: true, hasGoal: true }, "No package is here."],
  [
    "a place is proposed",
    { isProposed: true, hasGoal: true },
    "This position is proposed. Point elsewhere, then here again to confirm it.",
  ],
  [
    "names are spoken",
    { by: "name", hasGoal: true },
    "Point at things, or step by the arrow keys: their names are spoken. Press once you have heard the one that you want.",
  ],
  ["advised by a service", { isAdvised: true, hasGoal: true }, "Wear the band."],
  [
    "the site's goal",
    { hasGoal: true, canSelect: false },
    "Point at a box. For the kettle, press the button.",
  ],
  ["all want a press", { by: "press" }, "Move onto a thing and press the button."],
  [
    "staying selects",
    {},
    "Move onto a thing and stay on it until it is full. For the kettle, press the button.",
  ],
  ["nothing to select", { canSelect: false }, "Point anywhere: the arm follows you."],
];

for (const [name, facts, said] of CASES) {
  test(`row: ${name}`, () => {
    const all = { ...mine, ...facts };
    const { title, text } = guidance(all, words);
    assert.equal(rowOf(all).name, name);
    assert.equal([title === "You are the arm now." ? "" : title, text].filter(Boolean).join(" "), said);
  });
}

test("each row is tested once", () => {
  assert.deepEqual(
    CASES.map(([name]) => name),
    TABLE.map(({ name }) => name),
  );
});

function every(): Facts[] {
  const all: Facts[] = [];
  for (const last of ["", "asked", "pending", "done", "failed", "unanswered"] as const) {
    for (const barrier of ["", "unavailable", "starting", "taken", "late", "pending", "unwanted"] as const) {
      for (const does of ["", "select", "deselect", "refuse"] as const) {
        for (const mode of ["button", "switch", "claim"] as const) {
          for (const owner of ["", "page", "person", "other"] as const)
            for (const by of ["stay", "press", "name"] as const)
              all.push({ ...mine, isOnThing: true, last, barrier, does, mode, owner, by });
        }
      }
    }
  }
  return all;
}

test("a refusal, or a barrier, is never followed by a sentence that something was done", () => {
  for (const facts of every()) {
    if (["", "done"].includes(facts.last) && !facts.barrier) continue;
    const { step, text } = guidance(facts, words);
    assert.ok(!SUCCESS.test(text), `${JSON.stringify(facts)}: ${text}`);
    assert.notEqual(step, "press");
  }
});

/** Words by which a row tells that an act has succeeded, or that a thing is as an act made it. */
const SUCCESS = /has fired|is on\b|is off\b|is yours|is free|Continue with the next/;

test("a row tells a success only of an act whose outcome was told, or of what is selected", () => {
  for (const { name, when, say } of TABLE) {
    const isOfMoment = when.just !== undefined; // made of an event with its outcome
    const tellsAct = /has fired|is off|is free|Continue with the next/.test(say.text) && !isOfMoment;
    if (tellsAct) assert.equal(when.last, "done", name);
    const tellsOwner = /is on\b|is yours/.test(say.text);
    if (tellsOwner) assert.ok(when.owner && ![when.owner].flat().includes(""), `${name}: needs an owner`);
  }
});

test("whatever the facts are, nothing is told as done of an act without its outcome", () => {
  for (const facts of every().filter(({ last }) => last !== "done")) {
    const { text } = guidance(facts, words);
    assert.ok(
      !/has fired|is off|is free|Continue with the next/.test(text),
      `${JSON.stringify(facts)}: ${text}`,
    );
    if (facts.owner === "") assert.ok(!SUCCESS.test(text), `${JSON.stringify(facts)}: ${text}`);
  }
});

test("only who may take an arm is offered one, and every beginning has a card", () => {
  for (const who of ["nobody", "simulation", "device", "mouse", "phone", "headset"] as const) {
    const card = guidance({ ...mine, who }, words);
    assert.notEqual(card.mode, "none", who);
    assert.ok(card.offers.length > 0, who);
    assert.ok(!guidance({ ...mine, who, mayTake: false }, words).offers.includes("take"), who);
  }
});
