import assert from "node:assert/strict";
import { test } from "node:test";
import { encode } from "@msgpack/msgpack";
import type { Health, SelectionEvent, TrackedObject, TrackedObjects } from "../messages";
import type { Ask, PersonLine, Status } from "../wire";
import { Keeper } from "./apply";
import { Asks, Refusal } from "./asks";
import { decodeBatch, numberOf, Pending } from "./batch";
import { losses, rates } from "./figures";
import { Episodes, matching, note } from "./log";
import { outage } from "../outage";
import { emptySite, isSent, LOG_LINES } from "./site";
import { called, eventLine, ownCount } from "../words";
import { LatencyHistory, quantile, quantiles, SiteClock } from "./timing";

const cursor = (seq: number): Uint8Array => encode({ seq, stamp_ns: 5, point_m: [1, 2, 3] });
const personLine = (user: string): PersonLine => ({
  user,
  moved_by: "own",
  source: "device",
  is_mine: false,
  phone: "",
  battery: null,
  assumed: null,
});
const status = (...users: string[]): Status => ({
  kind: "status",
  services: [],
  findings: [],
  people: users.map(personLine),
  viewers: 1,
  lan_url: "",
  devices: [],
  run: "runs",
});

test("a batch is decoded, its payloads are not", () => {
  const payload = cursor(1);
  const batch = decodeBatch(
    encode([
      7,
      1.5e18,
      2,
      [
        ["users/{user}/cursor", "anna", payload],
        ["map", "", null],
      ],
      [],
      3,
    ]),
  );
  assert.equal(batch.n, 7);
  assert.equal(batch.speed, 2);
  assert.equal(batch.dropped, 3);
  assert.deepEqual(
    batch.states.map(({ topic, name }) => [topic, name]),
    [
      ["users/{user}/cursor", "anna"],
      ["map", ""],
    ],
  );
  assert.deepEqual([...batch.states[0]!.payload!], [...payload]);
  assert.equal(batch.states[1]!.payload, null);
});

test("what is no batch is refused in a sentence, its number saved where there is one", () => {
  for (const bad of [
    [1, 2],
    [1, "x", 1, [], [], 0],
    [1, 1, 1, {}, [], 0],
    [1, 1, 1, [["a", 2, null]], [], 0],
    "text",
    null,
  ]) {
    assert.throws(() => decodeBatch(encode(bad)), /batch/);
  }
  assert.throws(() => decodeBatch(new Uint8Array([0xc1])));
  assert.equal(numberOf(encode([9, "x"])), 9);
  assert.equal(numberOf(new Uint8Array([0xc1])), 0);
});

test("between two frames the newest state of each key wins, events all come", () => {
  const pending = new Pending();
  for (const n of [2, 3, 4]) {
    pending.add(
      decodeBatch(
        encode([
          n,
          0,
          1,
          [["users/{user}/cursor", "anna", cursor(n)]],
          [["selection/events", "", cursor(n)]],
          0,
        ]),
      ),
    );
  }
  const { states, events } = pending.take();
  assert.equal(states.length, 1);
  assert.equal(events.length, 3);
  assert.deepEqual([...states[0]!.payload!], [...cursor(4)]);
  assert.deepEqual(pending.take(), { states: [], events: [], history: [] });
});

test("events of the first batch are history: they are in the log at their times, once, and nothing happens", () => {
  const pending = new Pending();
  const site = emptySite();
  const keeper = new Keeper(site);
  const event = (stamp_ns: number, object_id: string) => ({
    topic: "selection/events",
    name: "",
    payload: encode({ stamp_ns, event: "selected", object_id, kind: "red", user: "anna", reason: "" }),
  });
  site.sentNs = 100e9;
  site.cameAt = performance.now();
  pending.add({
    n: 1,
    sentNs: 100e9,
    speed: 1,
    states: [],
    events: [event(40e9, "x-1"), event(70e9, "x-2"), event(70e9, "x-3")],
    dropped: 0,
  });
  const { events, history } = pending.take();
  assert.deepEqual([events.length, history.length], [0, 3]);
  for (let time = 0; time < 2; time++) {
    const knownNs = keeper.toldNs;
    for (const item of history) keeper.recall(item, knownNs);
  }
  assert.deepEqual(
    site.log.map(({ who, text }) => [who, text]),
    [
      ["anna", "selected red 1"],
      ["anna", "selected red 2"],
      ["anna", "selected red 3"],
    ],
  );
  assert.deepEqual(
    site.log.map(({ at }) => Math.round((Date.now() - at) / 10_000)),
    [6, 3, 3],
  );
  assert.deepEqual(site.fresh, []);
  keeper.take(event(101e9, "x-4"), 0);
  keeper.recall(event(101e9, "x-4"), keeper.toldNs);
  assert.equal(site.log.length, 4);
});

test("a vital service that is gone or hangs is one sentence with its cause", () => {
  const finding = (service: string, sentence: string, severity: "error" | "warning" = "error") => ({
    severity,
    code: sentence.includes("not reported") ? "silent" : "absent",
    service,
    sentence,
    remedy: "start it again",
    follows: false,
  });
  const line = (instance: string, present: boolean) => ({ instance, present, since_s: 1 });
  const told = (services: Status["services"], findings: Status["findings"]): string =>
    Object.values(outage({ status: { ...status(), services, findings } }) ?? {}).join(" ");
  assert.equal(outage({ status: null }), null);
  assert.equal(told([line("pui", true)], [finding("pui", "3 handlers failed")]), "", "it runs");
  assert.equal(told([line("selector", false)], []), "", "it was not to run");
  assert.equal(told([line("keeper", false)], [finding("keeper", "should run and does not")]), "");
  assert.equal(
    told([line("pui", false)], [finding("pui", "should run and does not")]),
    "Cursors and lights do not move: pui should run and does not; start it again",
  );
  const all = [
    finding("", "the router at x does not answer"),
    { ...finding("pui", "should run and does not"), follows: true },
  ];
  assert.equal(
    told([line("pui", false)], all),
    "The site is out of reach. The router at x does not answer; start it again",
    "what follows is not told",
  );
  assert.match(
    told([line("selector", true)], [finding("selector", "is present but has not reported for 5 s")]),
    /^Nothing can be selected: selector is present/,
  );
});

test("who is not in the status is not shown, and is shown with all that is known when they come", () => {
  const site = emptySite();
  const keeper = new Keeper(site);
  keeper.take({ topic: "users/{user}/cursor", name: "anna", payload: cursor(1) }, 12);
  assert.equal(site.people.size, 0);
  keeper.status(status("anna"));
  assert.equal(site.people.get("anna")?.cursor?.seq, 1);
  assert.equal(site.people.get("anna")?.cursorAt, 12);
  keeper.status(status());
  assert.equal(site.people.size, 0);
});

test("nothing for a payload takes away what the key had", () => {
  const site = emptySite();
  const keeper = new Keeper(site);
  keeper.take(
    { topic: "objects/{tracker}", name: "belt", payload: encode({ objects: [], seq: 0, stamp_ns: 0 }) },
    0,
  );
  keeper.take({ topic: "leds/{led}/color", name: "l1", payload: encode({ color: [1, 2, 3] }) }, 0);
  assert.equal(site.objects.size + site.lamps.size, 2);
  keeper.take({ topic: "objects/{tracker}", name: "belt", payload: null }, 0);
  keeper.take({ topic: "leds/{led}/color", name: "l1", payload: null }, 0);
  assert.equal(site.objects.size + site.lamps.size, 0);
});

test("unknown topics are passed over, what is no message is refused", () => {
  const keeper = new Keeper(emptySite());
  assert.equal(keeper.take({ topic: "newer", name: "", payload: cursor(1) }, 0), null);
  assert.equal(keeper.take({ topic: "constructor", name: "", payload: cursor(1) }, 0), null);
  assert.throws(() => keeper.take({ topic: "map", name: "", payload: encode(5) }, 0), /no message/);
});

test("quantiles of a known row", () => {
  assert.equal(quantile([], 0.5), null);
  assert.equal(quantile([7], 0.99), 7);
  const row = Array.from({ length: 101 }, (_, index) => 100 - index);
  assert.deepEqual(quantiles(row), { p50: 50, p95: 95, p99: 99 });
});

test("latencies go into the second in which they came, and are forgotten after a minute", () => {
  const history = new LatencyHistory(60);
  history.add(1_000, 10);
  history.add(60_900, 30);
  const seconds = history.bySecond(61_000);
  assert.equal(seconds.length, 60);
  assert.equal(seconds[59]!.p50, 30);
  assert.equal(seconds[0]!.p50, 10);
  assert.equal(seconds[30]!.p50, null);
  assert.equal(history.total(61_000).p50, 20);
  assert.equal(history.total(100_000).p50, 30);
  assert.equal(history.total(200_000).p50, null);
});

test("the site's clock follows the fastest batch, and a clock that was set anew", () => {
  const clock = new SiteClock();
  assert.equal(clock.heard(0, 1, 100), 100);
  assert.equal(clock.heard(10e6, 1, 130), 110); // 20 ms later than the fastest
  assert.equal(clock.heard(20e6, 1, 118), 118); // the fastest now
  assert.equal(clock.heard(30e6, 1, 150), 128);
  assert.equal(clock.heard(60_000e6, 1, 200), 200); // it jumped
  assert.equal(clock.heard(60_000e6, 2, 300), 300); // another speed
  assert.equal(clock.heard(60_200e6, 2, 450), 400); // 200 ms there are 100 here
});

test("the clock forgets the fastest batch of long ago, so that a drift is followed", () => {
  const clock = new SiteClock();
  for (let s = 0; s < 100; s += 1) clock.heard(s * 1e9, 1, s * 1001 + 50);
  const at = clock.heard(100e9, 1, 100 * 1001 + 50);
  assert.ok(100_150 - at <= 10.5);
});

test("answers find their asks; a refusal, a lost connection and silence end them", async () => {
  const sent: Ask[] = [];
  const asks = new Asks((ask) => sent.push(ask) > 0);
  const done = asks.ask({ key: "conveyor/set_speed", query: { speed_mps: 0.5 } });
  const refused = asks.ask({ deed: "take", name: "anna" });
  const lost = asks.ask({ deed: "give" });
  const silent = asks.ask({ deed: "press" }, 1);
  assert.deepEqual(
    sent.map(({ key, deed }) => key || deed),
    ["conveyor/set_speed", "take", "give", "press"],
  );
  asks.answered({ kind: "answer", id: sent[1]!.id, reply: null, error: "no", is_stale: false });
  asks.answered({
    kind: "answer",
    id: sent[0]!.id,
    reply: { message: "0.5 m/s" },
    error: "",
    is_stale: false,
  });
  asks.answered({ kind: "answer", id: 999, reply: {}, error: "", is_stale: false });
  assert.deepEqual(await done, { message: "0.5 m/s" });
  await assert.rejects(refused, /^Refusal|no/);
  await assert.rejects(silent, /in time/);
  asks.lost();
  await assert.rejects(lost, /lost/);
  await assert.rejects(new Asks(() => false).ask({ deed: "give" }), /no connection/);
  assert.ok(new Refusal("x") instanceof Error);
});

test("the log is bounded, filtered by words, newest first", () => {
  const site = emptySite();
  for (let n = 0; n < LOG_LINES + 50; n += 1) note(site, n % 2 ? "info" : "warning", "anna", `line ${n}`);
  assert.equal(site.log.length, LOG_LINES);
  assert.equal(site.logged, LOG_LINES + 50);
  const found = matching(site.log, "ANNA warning", 3);
  assert.deepEqual(
    found.map((line) => line.text),
    [448, 446, 444].map((n) => `line ${n}`),
  );
  assert.deepEqual(matching(site.log, "nothing like it", 3), []);
});

test("a warning that stands on is told once, whatever its figures; one that comes back is told again", () => {
  const episodes = new Episodes();
  const isNew = (at: number, sentence: string, service = "imu", code = "late"): boolean =>
    episodes.isNew(service, { code, sentence, severity: "warning", subject: "", topic: "" }, at);
  assert.equal(isNew(0, "12.5 of 100 samples are late"), true);
  for (let at = 1000; at < 30_000; at += 1000)
    assert.equal(isNew(at, `${at / 7} of 100 samples are late`), false);
  assert.equal(isNew(30_000, "3 of 100 samples are late", "ray"), true);
  assert.equal(isNew(60_000, "12.5 of 100 samples are late"), true);
  assert.deepEqual(
    [1, 1, 2].map((n) => isNew(60_000, `${n} of an older release`, "imu", "other")),
    [true, false, true],
  );
});

test("an object is called by its kind and the end of its id", () => {
  const site = emptySite();
  assert.equal(called(site, "a1b2-24", "red"), "red 24");
  assert.equal(called(site, "a1b2-24"), "object 24");
  const event = {
    event: "refused",
    object_id: "a1b2-24",
    kind: "red",
    user: "anna",
    reason: "it is gone",
  } as SelectionEvent;
  assert.equal(eventLine(site, event).text, "could not change red 24: it is gone");
});

test("buttons that fired are not counted as a person's own", () => {
  const site = emptySite();
  const object = (id: string, mode: "claim" | "button" | "switch") => ({ id, mode }) as TrackedObject;
  site.objects.set("things", {
    stamp_ns: 0,
    seq: 0,
    objects: [object("kettle", "button"), object("radio", "switch"), object("box", "claim")],
  } as unknown as TrackedObjects);
  const owned = (id: string, user: string) => ({
    id,
    user,
    kind: "",
    since_ns: 0,
    confidence: null,
    is_pending: false,
  });
  site.selection = {
    stamp_ns: 0,
    seq: 0,
    acts: [],
    undoable: [],
    objects: [
      owned("kettle", "ada"),
      owned("radio", "ada"),
      owned("box", "ada"),
      owned("gone", "ada"),
      owned("other", "ben"),
    ],
    reserved: [],
    method: null,
    dwell_s: null,
  };
  assert.equal(ownCount(site, "ada"), 2);
});

const health = (user: string, key: string, rate: number): Health => ({
  errors: 1,
  figures: [],
  host: "",
  instance: "",
  latency: null,
  pid: 1,
  seq: 0,
  service: "",
  stamp_ns: 0,
  status: "ok",
  problems: [],
  step: null,
  uptime_s: 0,
  user,
  warnings: [],
  keys: [{ age_s: 0, direction: "out", dropped: 2, invalid: 0, key, lost: 1, rate_hz: rate }],
});

test("rates are of one person, those of shared services shared out", () => {
  const all = [
    health("anna", "users/{user}/imu", 50),
    health("ben", "users/{user}/imu", 80),
    health("", "users/{user}/cursor", 100),
    health("", "strips/frame", 60),
  ];
  assert.deepEqual(rates(all, "anna", 2), { imu: 50, ray: null, cursor: 50, frame: 60 });
  assert.deepEqual(losses(all), { dropped: 8, lost: 4, invalid: 0, errors: 4 });
});

test("a place is proposed, sent or taken back; each is told in the log", () => {
  const site = emptySite();
  const keeper = new Keeper(site);
  keeper.status(status("anna"));
  const anna = site.people.get("anna")!;
  const cue = (name: string, point_m: number[] | null, text = name): void =>
    void keeper.take(
      { topic: "users/{user}/feedback", name: "anna", payload: encode({ cue: name, text, point_m }) },
      1,
    );
  cue("selected", [1, 2, 0], "send a robot there?");
  assert.deepEqual(anna.proposed, [1, 2, 0]);
  assert.equal(isSent(anna), false);
  keeper.take({ topic: "users/{user}/goal", name: "anna", payload: encode({ position_m: [1, 2, 0] }) }, 2);
  assert.equal(isSent(anna), true);
  cue("selected", [3, 2, 0]);
  assert.equal(isSent(anna), false);
  cue("selected", null, "red package");
  assert.deepEqual(anna.proposed, [3, 2, 0]);
  cue("deselected", [3, 2, 0], "no robot is sent");
  assert.equal(anna.proposed, null);
  assert.deepEqual(anna.goal?.position_m, [1, 2, 0]);
  assert.deepEqual(
    site.log.map(({ text }) => text),
    ["send a robot there?", "selected", "no robot is sent"],
  );
});
