import assert from "node:assert/strict";
import { test } from "node:test";
import { encode } from "@msgpack/msgpack";
import { Controls } from "../controls";
import { Keeper } from "./apply";
import { meantBy, robotAt, seenRobots, steeredBy, wayOf } from "./robots";
import { emptyPerson, emptySite, goalOf, proposalOf, type Site } from "./site";

const STATE = {
  stamp_ns: 0,
  seq: 0,
  kind: "ground",
  phase: "moving",
  position_m: [1, 0, 0],
  yaw_rad: 0,
  velocity_mps: [2, 0, 0],
  position_sigma_m: null,
  radius_m: 0.2,
  user: "ada",
  target_m: null,
  reason: "",
  reason_code: "",
  goal_ns: 0,
  battery: null,
} as const;

function heard(
  site: Site,
  topic: "state" | "plan",
  message: object | null,
  name = "cart",
  keeper = new Keeper(site),
): void {
  keeper.take(
    { topic: `robots/{robot}/${topic}`, name, payload: message && encode(message) },
    performance.now(),
  );
}

test("a robot is seen while its state is known, whatever came first", () => {
  const site = emptySite();
  heard(site, "plan", { line_m: [[3, 0, 0]], user: "ada" });
  assert.deepEqual(seenRobots(site), []);
  heard(site, "state", STATE);
  assert.deepEqual(
    seenRobots(site).map(({ name, plan }) => [name, plan?.line_m]),
    [["cart", [[3, 0, 0]]]],
  );
  assert.equal(steeredBy(site, "ada")?.name, "cart");
  assert.equal(steeredBy(site, ""), null);
  heard(site, "state", null);
  assert.deepEqual(seenRobots(site), []);
});

test("every robot with a known state can be stopped, whatever its service is called", () => {
  const site = emptySite();
  const controls = new Controls(site, {} as never, {} as never, {} as never, () => {});
  heard(site, "state", STATE, "robot"); // of `pointit service run robot`
  heard(site, "state", STATE, "cart");
  assert.deepEqual(controls.stoppable, []);
  site.connected = true;
  site.hello = { requests: ["robots/{robot}/stop"], deeds: [] } as never;
  assert.deepEqual(controls.stoppable, ["cart", "robot"]);
});

test("the log tells who steers a robot and why it does not move, not every change of a figure", () => {
  const site = emptySite();
  const keeper = new Keeper(site);
  for (const change of [
    {},
    { user: "" },
    { user: "", reason: "ben is 0.91 m away" },
    { user: "", reason: "ben is 0.87 m away" },
  ])
    heard(site, "state", { ...STATE, ...change }, "cart", keeper);
  assert.deepEqual(
    site.log.map(({ severity, who, text }) => [severity, who, text]),
    [
      ["info", "cart", "nobody steers it"],
      ["warning", "cart", "ben is 0.91 m away"],
    ],
  );
});

test("a robot is drawn where it is now, as long as it has been heard lately", () => {
  assert.deepEqual(robotAt(STATE as never, 2e8), [1.4, 0, 0]);
  assert.deepEqual(robotAt(STATE as never, 9e9), [2, 0, 0]);
});

test("a long way is drawn with fewer places, from the robot to its very end", () => {
  const line = Array.from({ length: 100 }, (_, i) => [i, 0, 0] as [number, number, number]);
  const way = wayOf(
    { name: "cart", state: null, plan: { line_m: line, user: "" } as never, heardAt: 0 },
    [-1, 0, 0],
    5,
  );
  assert.deepEqual(
    way.map(([x]) => x),
    [-1, 0, 25, 50, 74, 99],
  );
  assert.deepEqual(wayOf({ name: "cart", state: null, plan: null, heardAt: 0 }, [0, 0, 0]), []);
});

test("how probably a person means a robot is told until they have it", () => {
  const site = emptySite();
  const person = emptyPerson("ada");
  site.people.set("ada", person);
  person.steering = {
    candidates: [
      { object_id: "cart", probability: 0.7 },
      { object_id: "quad", probability: 0.3 },
    ],
  } as never;
  heard(site, "state", { ...STATE, user: "" });
  assert.deepEqual(meantBy(site, "cart"), [{ user: "ada", probability: 0.7 }]);
  heard(site, "state", STATE);
  assert.deepEqual(meantBy(site, "cart"), []);
});

test("who steers robots is asked to confirm no place, and their goal is shown while a robot carries it out", () => {
  const site = emptySite();
  const person = emptyPerson("ada");
  person.goal = { stamp_ns: 7, position_m: [1, 2, 0] } as never;
  person.proposed = [3, 4, 0];
  assert.deepEqual([proposalOf(person), goalOf(site, person)?.stamp_ns], [[3, 4, 0], 7]);
  person.steering = { robot: "cart" } as never;
  assert.deepEqual([proposalOf(person), goalOf(site, person)], [null, null]);
  heard(site, "state", { ...STATE, goal_ns: 7 });
  assert.equal(goalOf(site, person)?.stamp_ns, 7);
});

test("a robot whose service is silent is lost, however old its pose was; a past that stands still ages nothing", () => {
  const site = emptySite();
  const keeper = new Keeper(site);
  const now = performance.now();
  const phase = (after: number): string =>
    seenRobots(site, now + after)
      .map(({ state }) => `${state.phase} ${state.reason}`)
      .join();
  keeper.take({ topic: "robots/{robot}/state", name: "cart", payload: encode(STATE) }, now);
  assert.equal(phase(2500), "moving ");
  assert.equal(phase(3500), "lost its service is silent; the health page says more");
  keeper.hold(now, now + 3500);
  assert.equal(phase(3500), "moving ");
});
