/** Guidance for who steers robots: what the robot does, what a press does now, and why it stands. */

import { capital } from "./format";
import type { Said } from "./guidance";
import type { RobotState } from "./messages";
import { seenRobots, steeredBy, type SeenRobot } from "./site/robots";
import type { Person, Site } from "./site/site";

/** Minimum probability of the robot that a press would take. */
const MIN_MEANT = 0.5;

type RobotLine = Pick<RobotState, "kind" | "phase" | "reason" | "user"> & { name: string };

export interface RobotSituation {
  /** Robot that the person steers, or has asked for. */
  steered: RobotLine | null;
  asked: string;
  isLanding: boolean;
  waypoints: number;
  /** Robot that they point at, and one of theirs that was stopped. */
  meant: RobotLine | null;
  halted: RobotLine | null;
  user: string;
  /** Kinds of the robots that are there. */
  kinds: readonly RobotState["kind"][];
}

const KINDS: Record<RobotState["kind"], string> = { quadrotor: "the quadrotor", ground: "the ground robot" };
const line = (robot: SeenRobot | null | undefined): RobotLine | null =>
  robot ? { ...robot.state, name: robot.name } : null;

/** Robots as `person` may steer them; `last`: the one that they steered last. Null where nobody steers any. */
export function robotSituation(site: Site, person: Person, last: string): RobotSituation | null {
  const robots = seenRobots(site);
  const { steering, user } = person;
  if (!steering || !robots.length) return null;
  const named = (name: string | undefined): RobotLine | null =>
    line(robots.find((each) => each.name === name));
  const [first] = steering.candidates;
  const halted = named(last);
  return {
    steered: line(steeredBy(site, user)),
    asked: steering.robot,
    isLanding: steering.mode === "land",
    waypoints: steering.waypoints_m.length,
    meant: first && first.probability >= MIN_MEANT ? named(first.object_id) : null,
    halted: halted?.reason && ["stopped", "lost"].includes(halted.phase) ? halted : null,
    user,
    kinds: [...new Set(robots.map(({ state }) => state.kind))].sort(),
  };
}

/** The next step with robots. */
export function robotStep(now: RobotSituation): Pick<Said, "step" | "text"> & { press?: string } {
  const { steered, meant, halted } = now;
  if (steered) return steeredStep(now, steered, capital(steered.name));
  if (now.asked) return { step: "following", text: `${capital(now.asked)} is asked to follow you …` };
  if (meant?.user && meant.user !== now.user)
    return {
      step: "stopped",
      text: `${capital(meant.name)} is steered by ${meant.user}. Wait until it is free, or point at another robot.`,
    };
  if (meant)
    return {
      step: "press",
      text: `${capital(meant.name)}: press, and it is yours.`,
      press: `Take ${meant.name}`,
    };
  if (halted) return { step: "stopped", text: `${capital(halted.name)} was stopped: ${halted.reason}` };
  return {
    step: "aim",
    text: `Point at ${now.kinds.map((kind) => KINDS[kind]).join(" or ")}: then a press takes it.`,
  };
}

function steeredStep(
  now: RobotSituation,
  { kind, phase, reason, name }: RobotLine,
  Name: string,
): ReturnType<typeof robotStep> {
  if (reason || phase === "stopped" || phase === "lost") {
    const canLand = kind === "quadrotor" && (phase === "idle" || phase === "moving");
    return {
      step: "stopped",
      text: `${Name} ${phase === "lost" ? "is not heard" : "stands"}${reason ? `: ${reason}` : "."}`,
      ...(canLand ? { press: "Land here" } : {}),
    };
  }
  if (kind === "quadrotor") {
    if (phase === "landing") return { step: "following", text: `${Name} lands where you pointed …` };
    if (now.isLanding && phase !== "landed")
      return { step: "following", text: `${Name} is asked to land where you pointed …` };
    if (phase === "landed" || phase === "taking_off")
      return { step: "following", text: `${Name} is yours and takes off …` };
    return {
      step: "following",
      text: `${Name} follows where you point. A press lands it there.`,
      press: "Land here",
    };
  }
  if (now.waypoints) {
    const points = now.waypoints === 1 ? "1 place is" : `${now.waypoints} places are`;
    return {
      step: "press",
      text: `${points} on its way. Stay on the next, or press: ${name} goes.`,
      press: `Send ${name}`,
    };
  }
  if (phase === "moving")
    return { step: "following", text: `${Name} goes its way. Stay on a place to send it farther.` };
  return { step: "hold", text: `${Name} is yours. Stay on a place where it should go.` };
}
