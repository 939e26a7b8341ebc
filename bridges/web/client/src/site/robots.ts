/** Robots: what is known of each, where they are now, and in words. */

import type { RobotPlan, RobotState } from "../messages";
import { byName } from "../format";
import { elapsed } from "../geometry/motion";
import type { Vec3 } from "../geometry/vec";
import type { Site } from "./site";

/** All that is known of one robot. */
export interface Robot {
  readonly name: string;
  state: RobotState | null;
  plan: RobotPlan | null;
  /** `performance.now()` when the newest state came. */
  heardAt: number;
}

/** A robot whose state is known. */
export interface SeenRobot extends Robot {
  state: RobotState;
}

/** A robot without a newer state is lost, ms; it tells it ten times a second. */
const SILENT_MS = 3000;

/** Robots with a known state, in counting order of their names; `now` is `performance.now()`. */
export function seenRobots(site: Site, now = performance.now()): SeenRobot[] {
  return [...site.robots.values()]
    .filter((robot): robot is SeenRobot => robot.state !== null)
    .map((robot) =>
      now - robot.heardAt > SILENT_MS && robot.state.phase !== "lost"
        ? {
            ...robot,
            state: {
              ...robot.state,
              phase: "lost" as const,
              reason: "its service is silent; the health page says more",
            },
          }
        : robot,
    )
    .sort((a, b) => byName(a.name, b.name));
}

/** The robot that `user` steers, or null. */
export function steeredBy(site: Site, user: string): SeenRobot | null {
  return (user && seenRobots(site).find(({ state }) => state.user === user)) || null;
}

/** Position at `now_ns`, {W}, extrapolated by its velocity as tracked objects are. */
export function robotAt({ position_m, velocity_mps, stamp_ns }: RobotState, now_ns: number): Vec3 {
  const seconds = elapsed(stamp_ns, now_ns);
  return [0, 1, 2].map((axis) => position_m[axis]! + velocity_mps[axis]! * seconds) as Vec3;
}

/** Remaining path from the robot's position, at most `most` points. Empty if it has no path. */
export function wayOf({ plan }: Robot, at: Vec3, most = 24): Vec3[] {
  const line = plan?.line_m ?? [];
  if (!line.length) return [];
  const step = Math.max(1, (line.length - 1) / Math.max(most - 1, 1));
  const picked = Array.from(
    { length: Math.min(line.length, most) },
    (_, i) => line[Math.min(Math.round(i * step), line.length - 1)]!,
  );
  return [at, ...picked];
}

/** A person does not mean a robot with a smaller probability. */
const LEAST_MEANT = 0.1;

/** How probably each person means the robot called `name`, while they do not steer it. */
export function meantBy(site: Site, name: string): { user: string; probability: number }[] {
  return [...site.people.values()].flatMap(({ user, steering }) => {
    const found = steering?.candidates.find(({ object_id }) => object_id === name);
    return found && found.probability >= LEAST_MEANT && site.robots.get(name)?.state?.user !== user
      ? [{ user, probability: found.probability }]
      : [];
  });
}

const PHASES: Record<RobotState["phase"], string> = {
  landed: "landed",
  taking_off: "taking off",
  idle: "standing",
  moving: "driving",
  landing: "landing",
  stopped: "stopped",
  lost: "not heard",
};
const FLYING: Partial<typeof PHASES> = { idle: "hovering", moving: "flying" };

/** The phase in words. */
export function phaseOf({ kind, phase }: RobotState): string {
  return (kind === "quadrotor" ? FLYING[phase] : undefined) ?? PHASES[phase] ?? phase;
}

/** Height above the floor, or "" on the floor. */
export function heightOf({ kind, position_m: [, , z] }: RobotState): string {
  return kind === "quadrotor" && z >= 0.05 ? `${z.toFixed(1)} m up` : "";
}

/** Who steers it, its phase, target and battery, as one line. */
export function robotLine(state: RobotState): string {
  const [x, y] = state.position_m;
  const to = state.target_m;
  return [
    state.user ? `steered by ${state.user}` : "nobody steers it",
    phaseOf(state),
    to ? `to ${to[0].toFixed(1)}, ${to[1].toFixed(1)} m` : `at ${x.toFixed(1)}, ${y.toFixed(1)} m`,
    heightOf(state),
    state.battery === null ? "" : `battery ${Math.round(100 * state.battery)} %`,
  ]
    .filter(Boolean)
    .join(" · ");
}
