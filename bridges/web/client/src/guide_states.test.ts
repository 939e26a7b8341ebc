// What the card over the scene says: the states of pointing, of buttons, of robots, of the end of feeding.
import assert from "node:assert/strict";
import { test } from "node:test";
import type { ConveyorState, RobotState, Steering } from "./messages";
import { robotSituation, robotStep } from "./robot_guidance";
import { emptySentence, haveAllPassed, passedSentence, scoreOf } from "./run";
import { emptyPerson, emptySite } from "./site/site";
import { friendly, placeName } from "./words";

const robot = (part: Partial<RobotState> = {}): RobotState => ({
  battery: null,
  goal_ns: 0,
  kind: "quadrotor",
  phase: "landed",
  position_m: [0, 0, 0],
  position_sigma_m: null,
  radius_m: 0.15,
  reason: "",
  reason_code: "",
  seq: 0,
  stamp_ns: 0,
  target_m: null,
  user: "",
  velocity_mps: [0, 0, 0],
  yaw_rad: 0,
  ...part,
});
const steering = (part: Partial<Steering> = {}): Steering => ({
  candidates: [],
  mode: "none",
  robot: "",
  seq: 0,
  stamp_ns: 0,
  target_m: null,
  waypoints_m: [],
  ...part,
});

function steps(
  state: Partial<RobotState>,
  wish: Partial<Steering>,
  last = "",
): { step: string; text: string; press?: string } {
  const site = emptySite();
  const ada = emptyPerson("ada");
  ada.steering = steering(wish);
  site.people.set("ada", ada);
  site.robots.set("quad", { name: "quad", state: robot(state), plan: null, heardAt: performance.now() });
  return robotStep(robotSituation(site, ada, last)!);
}

test("a quadrotor has words before, during and after flight, and the reason of a stop", () => {
  const meant = { candidates: [{ object_id: "quad", probability: 0.9 }] };
  assert.match(steps({}, {}).text, /^Point at the quadrotor: then a press takes it/);
  assert.deepEqual(steps({}, meant), {
    step: "press",
    text: "Quad: press, and it is yours.",
    press: "Take quad",
  });
  assert.equal(steps({ user: "ben" }, meant).step, "stopped");
  assert.equal(steps({}, { robot: "quad", mode: "follow" }).step, "following");
  assert.match(
    steps({ user: "ada", phase: "taking_off" }, { robot: "quad", mode: "follow" }).text,
    /takes off/,
  );
  assert.deepEqual(
    steps({ user: "ada", phase: "idle" }, { robot: "quad", mode: "follow" }).press,
    "Land here",
  );
  assert.match(
    steps({ user: "ada", phase: "landing" }, { robot: "quad", mode: "land" }).text,
    /lands where you pointed/,
  );
  assert.deepEqual(
    steps(
      { user: "ada", phase: "moving", reason: "ben is 0.4 m away: wait" },
      { robot: "quad", mode: "follow" },
    ),
    { step: "stopped", text: "Quad stands: ben is 0.4 m away: wait", press: "Land here" },
  );
  const halted = steps({ phase: "stopped", reason: "from the page: point at it to take it" }, {}, "quad");
  assert.deepEqual(halted, {
    step: "stopped",
    text: "Quad was stopped: from the page: point at it to take it",
  });
  assert.equal(steps({ phase: "landed" }, {}, "quad").step, "aim", "after an ordinary flight");
});

test("a ground robot is taken, shown its way and sent", () => {
  const kind = "ground" as const;
  const user = "ada";
  assert.equal(steps({ kind, user, phase: "idle" }, { robot: "quad", mode: "goals" }).step, "hold");
  const two: [number, number, number][] = [
    [0, 0, 0],
    [1, 0, 0],
  ];
  const set = steps({ kind, user, phase: "idle" }, { robot: "quad", mode: "goals", waypoints_m: two });
  assert.deepEqual([set.step, set.press], ["press", "Send quad"]);
  assert.match(set.text, /^2 places are on its way/);
  assert.equal(steps({ kind, user, phase: "moving" }, { robot: "quad", mode: "goals" }).step, "following");
});

test("who steers no robots has no such words, whatever robots are there", () => {
  const site = emptySite();
  const ada = emptyPerson("ada");
  assert.equal(robotSituation(site, ada, ""), null);
  site.robots.set("quad", { name: "quad", state: robot(), plan: null, heardAt: performance.now() });
  assert.equal(robotSituation(site, ada, ""), null);
});

const conveyor = (part: Partial<ConveyorState>): ConveyorState => ({
  bays: [],
  belts: [],
  departures: [],
  fed: 0,
  feeding: true,
  left: 0,
  refused: 0,
  seq: 0,
  speed_mps: 0.5,
  stamp_ns: 0,
  step: "",
  ...part,
});

test("when the last package has passed, the card says how many of those to select were selected", () => {
  const bays = [
    { bay: "", kind: "red", count: 6, selected: 5 },
    { bay: "1", kind: "red", count: 4, selected: 3 },
    { bay: "", kind: "blue", count: 9, selected: 1 },
  ];
  const site = emptySite();
  const controls = { isWanted: (kind: string) => kind === "red", targetKinds: ["red"] };
  const after = (part: Partial<ConveyorState>) =>
    passedSentence(
      Object.assign(site, { conveyor: conveyor({ bays, fed: 19, left: 19, step: "end", ...part }) }),
      controls,
    );
  assert.equal(after({}), "All packages have passed: 8 of 10 red ones selected.");
  assert.deepEqual(
    scoreOf(site, () => true),
    { passed: 19, selected: 9 },
  );
  assert.equal(after({ left: 18 }), "", "one is still on its way");
  assert.equal(after({ step: "" }), "", "more are to come");
  assert.equal(after({ fed: 0, left: 0 }), "");
  assert.equal(after({ bays: [] }), "All packages have passed.");
  assert.ok(!haveAllPassed({ conveyor: null }));
});

test("an empty conveyor has its reason and a remedy instead of the scenario's goal", () => {
  const site = emptySite();
  const text = (part: Partial<ConveyorState>) =>
    emptySentence(Object.assign(site, { conveyor: conveyor(part) }));
  assert.equal(text({}), "", "the first is on its way");
  assert.match(text({ feeding: false }), /^No package is here: feeding is stopped\. Press Start feeding/);
  assert.match(text({ speed_mps: 0 }), /the belts stand still\. Press Start the belts\.$/);
  site.objects.set("conveyor", { stamp_ns: 0, seq: 0, objects: [{ id: "a" }] } as never);
  assert.equal(text({ feeding: false, speed_mps: 0 }), "", "one can still be selected");
  assert.equal(emptySentence(emptySite()), "", "no conveyor at all");
});

test("names of the map are shown without internal ids, in sentences of services, too", () => {
  assert.deepEqual(
    ["led_2", "lamp-3", "7", "behind_left", "Desk lamp", "_"].map((id) => placeName(id, "lamp")),
    ["lamp 2", "lamp 3", "lamp 7", "behind left", "Desk lamp", "_"],
  );
  assert.equal(placeName("0", "strip"), "strip 0");
  const map = {
    lamps: [
      { id: "led_1", position_m: [0, 0, 0] },
      { id: "led_10", position_m: [0, 0, 0] },
      { id: "door", position_m: [0, 0, 0] },
    ],
  } as never;
  assert.equal(
    friendly({ map }, "Point at led_10 and stay on it (1 of 2)."),
    "Point at lamp 10 and stay on it (1 of 2).",
  );
  assert.equal(friendly({ map }, "Point at door, not led_1."), "Point at door, not lamp 1.");
  assert.equal(friendly({ map: null }, "Point at led_1."), "Point at led_1.");
});
