/** Robots that people steer: body, heading, height above the floor, what is left of their way, and whose they are. */

import * as THREE from "three";
import type { RobotState } from "../messages";
import { casing, cssColor, visibleColor, type Rgb } from "../geometry/appearance";
import { LONGEST_S } from "../geometry/motion";
import type { Read3, Vec3 } from "../geometry/vec";
import { meantBy, phaseOf, robotAt, seenRobots, wayOf, type SeenRobot } from "../site/robots";
import { siteNow, type Person, type Site } from "../site/site";
import type { Beams } from "./beams";
import type { MeshFactory } from "./mesh_factory";
import type { Labels, Piece } from "./labels";
import type { Marks } from "./marks";
import { groundRobot, quadrotor } from "./robot_shapes";

/** Of a robot that nobody steers. */
const FREE: Rgb = [150, 160, 172];
/** A label stands so far above a robot, m. */
const LABEL_M = 0.24;

/** Shared parts of the scene. */
export interface Surroundings {
  readonly factory: MeshFactory;
  readonly marks: Marks;
  readonly beams: Beams;
  readonly labels: Labels;
}

/** All robots of a site. */
export class Robots {
  /** Where each is in this frame, {W}. */
  readonly places = new Map<string, Vec3>();
  private readonly bodies = new Map<string, THREE.Mesh>();
  private readonly shapes: Record<RobotState["kind"], THREE.BufferGeometry>;
  private readonly skin: THREE.Material;

  constructor(private readonly around: Surroundings) {
    const { factory } = around;
    this.shapes = { quadrotor: factory.own(quadrotor()), ground: factory.own(groundRobot()) };
    this.skin = factory.matt(0xffffff, { vertexColors: true, roughness: 0.45 });
  }

  /** What can be pointed at now. */
  targets(into: THREE.Object3D[]): void {
    into.push(...this.bodies.values());
  }

  /** Draw all as of now; returns whether any goes on moving. */
  draw(site: Site): boolean {
    const now_ns = siteNow(site);
    const seen = seenRobots(site);
    let moves = false;
    for (const [name, body] of this.bodies) {
      if (seen.some((robot) => robot.name === name)) continue;
      body.removeFromParent();
      this.bodies.delete(name);
      this.places.delete(name);
    }
    for (const robot of seen) {
      const at = robotAt(robot.state, now_ns);
      this.places.set(robot.name, at);
      this.one(site, robot, at);
      const age_s = (now_ns - robot.state.stamp_ns) / 1e9;
      moves ||= age_s < LONGEST_S && robot.state.velocity_mps.some((each) => each !== 0);
    }
    for (const person of site.people.values()) this.waypoints(person);
    return moves;
  }

  private one(site: Site, robot: SeenRobot, at: Vec3): void {
    const { marks, beams, labels, factory } = this.around;
    const { name, state } = robot;
    const { dark } = factory.theme;
    const owner = site.people.get(state.user)?.profile;
    const radius = state.radius_m;
    const color = state.user ? visibleColor(owner?.cursor_color ?? [255, 255, 255], dark) : FREE;
    const body = this.body(name, state.kind);
    const isFlying = state.kind === "quadrotor" && at[2] > 0.05;
    body.position.set(...at);
    body.rotation.z = state.yaw_rad;
    body.scale.setScalar(2 * radius);
    const floor: Vec3 = [at[0], at[1], 0.008];
    const alpha = state.phase === "lost" ? 0.4 : 1;
    if (isFlying) {
      marks.add(floor, radius, [0, 0, 0], { thick: 0.02, alpha: dark ? 0.5 : 0.25, fill: 1 });
      beams.add(at, floor, color, 0.7 * alpha, 1.4, 0.08);
    }
    marks.add(isFlying ? at : floor, 1.35 * radius, color, {
      pattern: owner?.pattern ?? "solid",
      thick: 0.12,
      alpha,
    });
    this.way(robot, at, color, alpha);
    labels.keepFree(at, 2.2 * radius, 2.2 * radius, radius, `robot ${name}`);
    const pieces: Piece[] = [{ text: name }];
    if (state.user) pieces.push({ text: state.user, color });
    for (const { user, probability } of meantBy(site, name)) {
      const worn = site.people.get(user)?.profile?.cursor_color ?? [255, 255, 255];
      pieces.push({ text: `${user} ${Math.round(100 * probability)} %`, color: visibleColor(worn, dark) });
    }
    if (state.phase === "stopped" || state.phase === "lost") pieces.push({ text: phaseOf(state) });
    labels.add(
      `robot ${name}`,
      at,
      (isFlying ? 0 : radius) + LABEL_M,
      pieces,
      state.user ? cssColor(color) : "",
      2,
    );
  }

  private way(robot: SeenRobot, at: Vec3, color: Rgb, alpha: number): void {
    const { marks, beams, factory } = this.around;
    const way = wayOf(robot, at);
    const target = robot.state.target_m;
    for (let i = 1; i < way.length; i++) {
      beams.add(way[i - 1]!, way[i]!, casing(factory.theme.dark), 0.5 * alpha, 3.6);
      beams.add(way[i - 1]!, way[i]!, color, 0.9 * alpha, 2.2, 0.16);
    }
    if (target)
      marks.add(
        target,
        robot.state.radius_m,
        color,
        { pattern: "dashed", thick: 0.14, fill: 0.12, alpha },
        0.012,
      );
  }

  /** Way-points that are set and not yet sent, numbered. */
  private waypoints({ user, steering, profile }: Person): void {
    const { marks, beams, labels, factory } = this.around;
    const points = steering?.waypoints_m ?? [];
    const color = visibleColor(profile?.cursor_color ?? [255, 255, 255], factory.theme.dark);
    points.forEach((point: Read3, i) => {
      marks.add(point, 0.11, color, { pattern: profile?.pattern ?? "solid", thick: 0.26, fill: 0.4 }, 0.012);
      labels.add(`way-point ${user} ${i}`, point, 0.16, [{ text: String(i + 1), color }], "", 2);
      if (i > 0) beams.add(points[i - 1]!, point, color, 0.8, 1.6, 0.1);
    });
  }

  private body(name: string, kind: RobotState["kind"]): THREE.Mesh {
    let body = this.bodies.get(name);
    if (body?.geometry !== this.shapes[kind]) {
      body?.removeFromParent();
      body = this.around.factory.mesh(this.shapes[kind], this.skin);
      this.bodies.set(name, body);
    }
    return body;
  }
}
