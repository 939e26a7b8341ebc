// Whatever order and delay the messages of acts have, no screen tells a success that has not been told by an outcome.
import assert from "node:assert/strict";
import { test } from "node:test";
import { encode } from "@msgpack/msgpack";
import { Controls } from "./controls";
import { factsOf } from "./facts";
import { guidance } from "./guidance";
import type { ActState, Hover, Selection, SelectionEvent, TrackedObject } from "./messages";
import { objectRows } from "./plan/sentences";
import { Keeper } from "./site/apply";
import type { Item } from "./site/batch";
import { emptySite, ownersOf } from "./site/site";
import { thingTiles } from "./site/things";

const ACTS = 200;
const MAX_LATE_S = 2;
const MODES = { bell: "button", radio: "switch", box: "claim" } as const;
type Name = keyof typeof MODES;
const NAMES = Object.keys(MODES) as Name[];
const PEOPLE = ["ada", "ben"];

/** Numbers from 0 to 1 that are the same at each run. */
function randomOf(seed: number): () => number {
  let state = seed;
  return () => {
    state = (state * 1664525 + 1013904223) % 2 ** 32;
    return state / 2 ** 32;
  };
}

interface Sent {
  readonly key: string;
  readonly item: Item;
  readonly at: number;
}

interface Act {
  readonly state: ActState;
  readonly name: Name;
  /** When its outcome said that it was done or had started, s. */
  doneAt: number;
  startedAt: number;
}

/** What a selector, its carriers and the page's server send of 200 acts that end in every way, with restarts. */
function sentMessages(random: () => number): { sent: Sent[]; acts: Act[] } {
  const sent: Sent[] = [];
  const acts: Act[] = [];
  let states: ActState[] = [];
  let selected = new Map<Name, { user: string; isPending: boolean }>();
  let now = 1;
  const send = (topic: string, name: string, message: object): void =>
    void sent.push({
      key: `${topic} ${name}`,
      item: { topic, name, payload: encode(message) } as Item,
      at: now,
    });
  const stamp = (): number => Math.round(now * 1e9);
  const sendSelection = (): void => {
    const objects = [...selected].map(([id, { user, isPending }]) => ({ id, user, is_pending: isPending }));
    send("selection", "", { stamp_ns: stamp(), objects, reserved: [], acts: states } as unknown as Selection);
  };
  const hover = (user: string, name: Name | "", act: Partial<Hover> = {}): void =>
    send("users/{user}/hover", user, {
      stamp_ns: stamp(), object_id: name, progress: 0, action: name ? "select" : "", taken_by: "", act_ns: null, ...act,
    }); // prettier-ignore
  const setState = (act: Act, change: Partial<ActState>): void => {
    Object.assign(act.state, change);
    states = states.map((each) => (each.event_ns === act.state.event_ns ? { ...act.state } : { ...each }));
  };
  /** The server of the page sends an event with its result. */
  const tell = (act: Act, event: SelectionEvent["event"]): void =>
    send("selection/events", "", {
      event, object_id: act.name, user: act.state.user, cause: "dwell", stamp_ns: act.state.event_ns, kind: act.name,
      reason: act.state.text, bay: "", confidence: null, seq: 0, carriers: [], status: act.state.status,
      begin_within_s: null,
    }); // prettier-ignore

  for (let count = 0; count < ACTS; count++) {
    const user = PEOPLE[Math.floor(random() * PEOPLE.length)]!;
    const name = NAMES[Math.floor(random() * NAMES.length)]!;
    const before = selected.get(name);
    const isOff = before !== undefined && MODES[name] !== "button";
    hover(user, name, { action: isOff ? "deselect" : "select" });
    now += 0.1 + random();
    const state: ActState = {
      object_id: name, user, event_ns: stamp(), asked_ns: stamp(), effect: isOff ? "deselect" : "select",
      status: "asked", code: "", text: "",
    }; // prettier-ignore
    const act: Act = { state, name, doneAt: Infinity, startedAt: Infinity };
    acts.push(act);
    states = [...states.filter((each) => each.object_id !== name || each.user !== user), state];
    if (isOff) selected.delete(name);
    else selected.set(name, { user, isPending: true });
    sendSelection();
    hover(user, name, { action: "", act_ns: state.asked_ns });
    now += random();

    const isRestarted = random() < 0.05; // what is over is forgotten, what is asked is waited for
    if (isRestarted) {
      states = states.filter((each) => each.status === "asked");
      hover(user, name, { action: "" });
      sendSelection();
    }
    const fate = random();
    if (fate < 0.2) {
      setState(act, { status: "pending" });
      act.startedAt = now;
      if (!isOff) selected.set(name, { user, isPending: false });
      sendSelection();
      tell(act, isOff ? "deselected" : "selected");
      now += random();
    }
    if (fate > 0.55) {
      setState(act, fate > 0.8 ? { status: "unanswered", code: "no_answer", text: "late" } : { status: "failed", code: "error", text: "no" }); // prettier-ignore
      if (isOff) selected.set(name, before!);
      else selected.delete(name);
      sendSelection();
      tell(act, "refused");
    } else {
      act.doneAt = now;
      setState(act, { status: "done" });
      if (!isOff) selected.set(name, { user, isPending: false });
      sendSelection();
      if (fate >= 0.2) tell(act, isOff ? "deselected" : "selected");
      if (MODES[name] === "button") {
        now += 0.6;
        selected = new Map([...selected].filter(([id]) => id !== name));
        sendSelection();
      }
    }
    if (random() < 0.5) hover(user, "");
    now += random();
  }
  return { sent, acts };
}

/** The messages as they arrive: those of one key and writer in order, each late by up to `MAX_LATE_S`. */
function arrived(sent: readonly Sent[], random: () => number): Sent[] {
  const last = new Map<string, number>();
  const late = sent.map((each) => {
    const at = Math.max(each.at + random() * MAX_LATE_S, last.get(each.key) ?? 0);
    last.set(each.key, at);
    return { ...each, at };
  });
  return late.sort((a, b) => a.at - b.at);
}

const isDone = (acts: readonly Act[], at: number, name: Name, ...effects: string[]): boolean =>
  acts.some((each) => each.name === name && effects.includes(each.state.effect) && each.doneAt <= at);

for (let seed = 1; seed <= 20; seed++) {
  test(`no screen tells a false success of 200 acts, in the order of seed ${seed}`, () => {
    const random = randomOf(seed);
    const { sent, acts } = sentMessages(random);
    const site = emptySite();
    const controls = new Controls(site, {} as never, {} as never, {} as never, () => {});
    const things = NAMES.map((id) => ({ id, mode: MODES[id], dwell_s: null, label: "", press: false }));
    const objects = NAMES.map(
      (id) =>
        ({ id, kind: id, mode: MODES[id], surface: "none", size_m: [1, 1, 1], position_m: [0, 0, 0] }) as unknown as TrackedObject,
    ); // prettier-ignore
    Object.assign(site, {
      connected: true,
      hello: { deeds: ["take"], requests: [] },
      map: { things, lamps: [], strips: [], belts: [] },
      status: { services: [{ instance: "selector", present: true, since_s: 60 }], people: [] },
    });
    site.objects.set("things", { stamp_ns: 0, objects } as never);
    const keeper = new Keeper(site);
    for (const user of PEOPLE) {
      const person = keeper.person(user);
      site.people.set(user, person);
      Object.assign(person, {
        line: { user, moved_by: "mouse", is_mine: true, source: "none" },
        interaction: { state: "pointing", next_step: "next", press: "" },
      });
    }

    let told = 0;
    for (const { item, at } of arrived(sent, random)) {
      keeper.take(item, at * 1000);
      for (const user of PEOPLE) {
        const person = site.people.get(user)!;
        const name = person.hover?.object_id as Name;
        const { facts, words } = factsOf(controls, person, false, null);
        const { text } = guidance(facts, words);
        if (!/has fired|is off\b|is free|Continue with the next/.test(text)) continue;
        told += 1;
        const act = acts.find(
          (each) => each.state.user === user && each.state.asked_ns === person.hover!.act_ns,
        );
        assert.ok(act && act.doneAt <= at, `${user} at ${at} s: ${text}`);
        assert.equal(act.name, name);
      }
      for (const tile of thingTiles(site)) {
        const name = tile.id as Name;
        if (tile.isOn || /^(Fired|On|Taken)/.test(tile.state))
          assert.ok(isDone(acts, at, name, "select"), tile.state);
        const last = acts.filter((each) => each.name === name);
        if (/^(Fired|Switched|Selected|Taken)/.test(tile.last))
          assert.ok(last.some(({ doneAt }) => doneAt <= at), tile.last); // prettier-ignore
        if (/^Started/.test(tile.last))
          assert.ok(
            last.some(({ startedAt }) => startedAt <= at),
            tile.last,
          );
      }
      for (const [id] of ownersOf(site))
        assert.ok(acts.some((each) => each.name === id && Math.min(each.doneAt, each.startedAt) <= at));
      for (const { text, object } of objectRows(site))
        if (/ by /.test(text)) assert.ok(isDone(acts, at, object.id as Name, "select"), text);
      for (const { event } of site.fresh.flatMap((each) => ("event" in each ? [each] : []))) {
        const act = acts.find((each) => each.state.event_ns === Number(event.stamp_ns))!;
        if (event.event !== "refused")
          assert.ok(
            (event.status === "done" ? act.doneAt : act.startedAt) <= at,
            `${event.event} at ${at} s`,
          );
      }
      site.fresh.length = 0;
    }
    assert.ok(told > 50, `only ${told} times a success was told`);
  });
}
