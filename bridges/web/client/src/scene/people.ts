/** People: pose and its uncertainty, ray, cursor, and the lamp to point at. */

import { goalOf, isHeard, proposalOf, standingOf, type Person, type Site } from "../site/site";
import { DEFAULT_BODY, eyesOf, hangingArm, pointingArm, type Arm } from "../geometry/body";
import { ellipseOf } from "../geometry/ellipse";
import { casing, cssColor, rayEnd, visibleColor, type Pattern } from "../geometry/appearance";
import { add, subtract, unit, wrapped, type Read3, type Vec3 } from "../geometry/vec";
import type { Beams } from "./beams";
import { Figure } from "./figure";
import { MeshFactory } from "./mesh_factory";
import type { Labels } from "./labels";
import type { Marks } from "./marks";

/** A pointing person without a cursor for this long is shown faintly, ms. */
const STALE_MS = 2000;
/** A name stands at most so high, m. */
const NAME_M = 2.15;
/** A head's middle is about where its eyes are; this is more than half its height, m. */
const HEAD_M = 0.16;
/** Width of what is kept free about a body, m. */
const BODY_M = 0.5;
/** A goal's flag is so high, m. */
const FLAG_M = 0.8;
const RAISE_PER_S = 4;
const TURN_PER_S = 7;
const WHITE: Read3 = [255, 255, 255];
/** How opaque a ray is, and at its end as a share of that. */
const RAY = 0.95;
const RAY_END = 0.9;

interface Body {
  readonly factory: MeshFactory;
  readonly figure: Figure;
  readonly looks: string;
  facing: number;
  /** How far the arm is raised, 0 to 1. */
  raised: number;
  arm: Arm | null;
}

/** Shared geometry of people, and the map's targets. */
export interface Surroundings {
  readonly factory: MeshFactory;
  readonly marks: Marks;
  readonly beams: Beams;
  readonly labels: Labels;
  /** Where a lamp or object is; null: unknown. */
  placeOf(id: string): Read3 | null;
}

/** No figure is drawn about a viewer who is so near, m. */
const NEAR_M = 0.5;

/** Whether a figure at `feet` would be about the eyes of a viewer. */
export function isAbout([x, y]: Read3, feet: Read3): boolean {
  return Math.hypot(x - feet[0], y - feet[1]) < NEAR_M;
}

/** All people of a site. */
export class People {
  private readonly bodies = new Map<string, Body>();

  constructor(
    private readonly around: Surroundings,
    private readonly isStill: boolean,
  ) {}

  /** What a camera must show of people: their feet, and their names above their heads. */
  static points(site: Site): Vec3[] {
    return [...site.people.values()].flatMap((person) => {
      const feet = standingOf(person)?.position_m;
      return feet ? [feet, add(feet, [0, 0, NAME_M])] : [];
    });
  }

  /** Where the eyes of `person` are, {W}; null: unknown. */
  static eyes(person: Person | undefined): Vec3 | null {
    const feet = person ? feetOf(person) : null;
    return feet ? eyesOf(person?.profile?.body ?? DEFAULT_BODY, feet) : null;
  }

  /**
   * Draw everybody as of `now` (`performance.now()`), `seconds` after the frame before; returns whether
   * anybody goes on moving.
   *
   * @param own person whose eyes the camera uses, or ""
   * @param viewer eyes of a headset's wearer, {W}: no figure is drawn about them
   */
  draw(site: Site, now: number, seconds: number, own: string, viewer: Vec3 | null): boolean {
    let moves = false;
    for (const [user, body] of this.bodies) {
      if (site.people.has(user)) continue;
      body.factory.dispose();
      this.bodies.delete(user);
    }
    for (const person of site.people.values())
      moves = this.one(site, person, now, seconds, own, viewer) || moves;
    return moves;
  }

  private one(
    site: Site,
    person: Person,
    now: number,
    seconds: number,
    own: string,
    viewer: Vec3 | null,
  ): boolean {
    const feet = feetOf(person);
    const { dark } = this.around.factory.theme;
    const worn = person.profile?.cursor_color ?? WHITE;
    const color = visibleColor(worn, dark);
    const pattern = person.profile?.pattern ?? "solid";
    const asked = this.beacon(person, color, now);
    this.goal(site, person, color);
    if (!feet) return asked;
    const measures = person.profile?.body ?? DEFAULT_BODY;
    const hand = person.profile?.hand ?? "right";
    const body = this.body(person, worn);
    const { cursor } = person;
    const age = now - person.cursorAt;
    const points = cursor?.direction && isHeard(person, now);
    const origin = cursor?.origin_m ?? eyesOf(measures, feet);
    const target = points ? null : this.askedFor(person);
    const direction = points ? cursor.direction : target ? unit(subtract(target, origin)) : null;
    const isAssumed = !person.pose && !cursor?.origin_m;
    const isStale =
      !site.connected || (person.interaction?.state === "pointing" && age > STALE_MS && person.cursorAt > 0);
    const gain = this.isStill ? 1 : 1 - Math.exp(-seconds * TURN_PER_S);
    const turn = direction ? wrapped(Math.atan2(direction[1], direction[0]) - body.facing) : 0;
    body.facing += turn * gain;
    const wanted = direction ? 1 : 0;
    const step = this.isStill ? 1 : seconds * RAISE_PER_S;
    body.raised += Math.min(Math.max(wanted - body.raised, -step), step);
    const hangs = hangingArm(measures, hand, feet, body.facing);
    if (direction) body.arm = pointingArm(measures, hand, feet, body.facing, origin, direction);
    const arm = body.arm && body.raised > 0 ? mixed(hangs, body.arm, smooth(body.raised)) : hangs;
    body.figure.stand(feet, body.facing);
    const isNear = viewer !== null && isAbout(viewer, feet);
    const isOwn = isNear || person.user === own;
    body.figure.setArm(0, arm, !isOwn ? "all" : body.raised > 0.4 && !isNear ? "own" : "none");
    body.figure.setArm(
      1,
      hangingArm(measures, hand === "left" ? "right" : "left", feet, body.facing),
      isOwn ? "none" : "all",
    );
    body.figure.see(isStale ? 0.35 : isAssumed ? 0.5 : 1, isOwn);
    this.uncertainty(person, feet, color, isStale, isAssumed);
    if (cursor && points) this.pointing(person, arm, origin, color, pattern, isStale, isOwn);
    if (!isOwn) {
      const eyes = eyesOf(measures, feet);
      const head = eyes[2] - feet[2] + HEAD_M;
      this.around.labels.keepFree([feet[0], feet[1], feet[2] + head / 2], BODY_M, BODY_M / 2, head);
      this.around.labels.keepFree(eyes, 2 * HEAD_M, 2 * HEAD_M, 2 * HEAD_M);
      this.around.labels.add(
        `user ${person.user}`,
        feet,
        measures.footprint_to_neck_m + measures.neck_to_eyes_m + 0.26,
        [{ text: person.user }, ...(isAssumed ? [{ text: "· place to be found" }] : [])],
        cssColor(color),
        2,
      );
    }
    return asked || Math.abs(turn) > 0.002 || body.raised !== wanted;
  }

  private pointing(
    person: Person,
    arm: Arm,
    origin: Read3,
    color: Read3,
    pattern: Pattern,
    isStale: boolean,
    isOwn: boolean,
  ): void {
    const { beams, marks, factory } = this.around;
    const { cursor } = person;
    const alpha = isStale ? 0.3 : 1;
    const at = cursor?.point_m ?? rayEnd(origin as Vec3, cursor!.direction!);
    const edge = casing(factory.theme.dark);
    const end = cursor?.point_m ? RAY_END : 0;
    beams.add(arm.finger, at, edge, 0.8 * alpha, 4.4, 0, end);
    beams.add(arm.finger, at, color, RAY * alpha, 2.6, 0, end);
    if (!isOwn) beams.add(origin, arm.finger, color, 0.5 * alpha, 1.6, 0.05);
    if (!cursor?.point_m) return;
    marks.add(at, 0.17, color, { pattern: "glow", faces: true, alpha });
    marks.add(at, 0.08, edge, { faces: true, thick: 0.42, alpha: 0.85 * alpha });
    marks.add(at, 0.07, color, { pattern, faces: true, thick: 0.26, alpha });
  }

  /** A flag where they sent a robot; a dashed ring where they may. */
  private goal(site: Site, person: Person, color: Read3): void {
    const { marks, beams, labels } = this.around;
    const goal = goalOf(site, person);
    const proposed = proposalOf(person);
    if (proposed) marks.add(proposed, 0.3, color, { pattern: "dashed", thick: 0.2, fill: 0.15 }, 0.012);
    if (!goal) return;
    marks.add(goal.position_m, 0.3, color, { thick: 0.2, fill: 0.3 }, 0.012);
    beams.add(goal.position_m, add(goal.position_m, [0, 0, FLAG_M]), color, 0.9, 2);
    labels.add(
      `goal ${person.user}`,
      goal.position_m,
      FLAG_M,
      [{ text: `goal of ${person.user}` }],
      cssColor(color),
      2,
    );
  }

  private uncertainty(person: Person, feet: Read3, color: Read3, isStale: boolean, isAssumed: boolean): void {
    const { marks } = this.around;
    const alpha = isStale ? 0.3 : 0.85;
    const { major, minor, angle } = person.pose
      ? ellipseOf(person.pose.covariance)
      : { major: 0, minor: 0, angle: 0 };
    marks.add(
      feet,
      0.27,
      [0, 0, 0],
      { thick: 0.02, alpha: this.around.factory.theme.dark ? 0.3 : 0.13, fill: 1 },
      0.006,
    );
    if (major > 0.02) {
      marks.add(feet, major, color, { thick: 0.08, alpha, fill: 0.22 }, 0.01, Math.max(minor, 0.01), angle);
    } else marks.add(feet, 0.3, color, { thick: 0.12, alpha, pattern: isAssumed ? "dashed" : "solid" }, 0.01);
  }

  /** Where they are asked to point now. */
  private askedFor(person: Person): Read3 | null {
    const found = person.localization;
    if (found?.phase !== "sampling" || !found.target_id || found.ahead.length) return null;
    return this.around.placeOf(found.target_id);
  }

  private beacon(person: Person, color: Read3, now: number): boolean {
    const at = this.askedFor(person);
    const { marks, beams, labels } = this.around;
    if (!at) return false;
    const beat = this.isStill ? 0.4 : (now / 1300) % 1;
    marks.add(at, 0.14, color, { faces: true, thick: 0.14 });
    marks.add(at, 0.5 - 0.34 * beat, color, { faces: true, thick: 0.07, alpha: Math.min(beat * 2, 1) });
    beams.add([at[0], at[1], at[2] + 0.16], [at[0], at[1], at[2] + 1.5], color, 0.8, 7, 0, 0);
    beams.add([at[0], at[1], 0.02], at, color, 0.45, 3);
    marks.add([at[0], at[1], 0], 0.18 + 0.3 * beat, color, { thick: 0.12, alpha: 1 - beat }, 0.02);
    const share = Math.round(100 * (person.localization?.progress ?? 0));
    labels.add(
      `beacon ${person.user}`,
      at,
      0.42,
      [{ text: "point here" }, { text: person.user, color }, { text: `${share} %` }],
      cssColor(color),
      3,
    );
    return !this.isStill;
  }

  private body(person: Person, color: Read3): Body {
    const measures = person.profile?.body ?? DEFAULT_BODY;
    const looks = JSON.stringify([measures, color]);
    const before = this.bodies.get(person.user);
    if (before?.looks === looks) return before;
    before?.factory.dispose();
    const factory = new MeshFactory(this.around.factory.light, this.around.factory.theme);
    this.around.factory.group.add(factory.group);
    const body: Body = {
      factory,
      looks,
      figure: new Figure(factory, measures, color),
      facing: before?.facing ?? standingOf(person)?.yaw_rad ?? 0,
      raised: before?.raised ?? 0,
      arm: null,
    };
    this.bodies.set(person.user, body);
    return body;
  }

  dispose(): void {
    for (const body of this.bodies.values()) body.factory.dispose();
    this.bodies.clear();
  }
}

/** Where a person stands; from their eyes while there is no pose, else where they are taken to stand. */
function feetOf(person: Person): Vec3 | null {
  const eyes = person.cursor?.origin_m;
  if (!person.pose && eyes) return subtract(eyes, eyesOf(person.profile?.body ?? DEFAULT_BODY, [0, 0, 0]));
  return standingOf(person)?.position_m ?? null;
}

const smooth = (x: number): number => x * x * (3 - 2 * x);

function mixed(a: Arm, b: Arm, share: number): Arm {
  const mix = (x: Vec3, y: Vec3): Vec3 => [0, 1, 2].map((i) => x[i]! + (y[i]! - x[i]!) * share) as Vec3;
  return {
    shoulder: mix(a.shoulder, b.shoulder),
    elbow: mix(a.elbow, b.elbow),
    wrist: mix(a.wrist, b.wrist),
    finger: mix(a.finger, b.finger),
  };
}
