/** People in the plan: body, arm, ray, cursor, hover progress, uncertainty of the position. */

import { mark, write } from "../dom";
import { goalOf, isHeard, proposalOf, standingOf, type Person, type Site } from "../site/site";
import { DEFAULT_BODY, hangingArm, pointingArm } from "../geometry/body";
import { ellipseOf } from "../geometry/ellipse";
import { rayEnd } from "../geometry/appearance";
import type { Packages } from "./packages";
import { styleOf } from "./person_style";
import { cm, draw, path, show, turned, xy } from "./svg";

const ACTIONS = { select: "+", deselect: "−", refuse: "×", "": "" } as const;

interface Figure {
  layers: Element[];
  unsure: SVGEllipseElement;
  body: SVGGElement;
  torso: SVGElement;
  arm: SVGPathElement;
  name: SVGTextElement;
  nameAt: SVGGElement;
  rayEdge: SVGPathElement;
  ray: SVGPathElement;
  cursor: SVGGElement;
  ring: SVGElement;
  dot: SVGElement;
  gauge: SVGGElement;
  arc: SVGElement;
  action: SVGTextElement;
  flag: SVGGElement;
  proposal: SVGGElement;
}

/** Where a person looks, rad: along their ray, else along {H}'s x axis. */
export function facing(person: Person, isFresh: boolean): number {
  const ray = isFresh ? person.cursor?.direction : null;
  if (ray && Math.hypot(ray[0], ray[1]) > 0.15) return Math.atan2(ray[1], ray[0]);
  return standingOf(person)?.yaw_rad ?? 0;
}

export class People {
  private readonly figures = new Map<string, Figure>();

  /** Layers of the plan: on the floor, bodies, and above everything. */
  constructor(
    private readonly floor: Element,
    private readonly bodies: Element,
    private readonly top: Element,
  ) {}

  update(site: Site, packages: Packages, chosen: string): void {
    const gauges = new Map<string, number>();
    for (const person of site.people.values()) {
      const figure = this.figures.get(person.user) ?? this.make(person.user);
      const isFresh = isHeard(person, performance.now());
      this.drawBody(figure, person, isFresh, chosen);
      this.drawRay(figure, person, isFresh);
      this.drawGauge(figure, person, isFresh, packages, gauges);
      this.drawGoal(figure, site, person);
    }
    for (const [user, figure] of this.figures) {
      if (site.people.has(user)) continue;
      for (const layer of figure.layers) layer.remove();
      this.figures.delete(user);
    }
  }

  private make(user: string): Figure {
    const below = draw(this.floor, "g");
    const middle = draw(this.bodies, "g");
    const above = draw(this.top, "g");
    const unsure = draw(below, "ellipse", { class: "plan-unsure" });
    const proposal = draw(below, "g");
    const flag = draw(above, "g");
    const pole = draw(flag, "g", { class: "plan-upright" });
    for (const name of ["plan-goal-edge", ""]) {
      draw(proposal, "circle", { class: name || "plan-proposal", r: 30 });
      draw(pole, "path", { class: name || "plan-flag", d: "M0 0V-26L17 -20L0 -13" });
    }
    const arm = draw(middle, "path", { class: "plan-arm" });
    const body = draw(middle, "g");
    const torso = draw(body, "ellipse", { class: "plan-torso", rx: 13, ry: 24 });
    draw(body, "path", { class: "plan-nose", d: "M16 0L8 -6L8 6Z" });
    draw(body, "circle", { class: "plan-head", r: 10.5 });
    const nameAt = draw(middle, "g");
    const name = draw(draw(nameAt, "g", { class: "plan-upright" }), "text", {
      class: "plan-name plan-person",
      "text-anchor": "middle",
    });
    const rayEdge = draw(above, "path", { class: "plan-ray-edge" });
    const ray = draw(above, "path", { class: "plan-ray" });
    const cursor = draw(above, "g");
    const upright = draw(cursor, "g", { class: "plan-upright" });
    draw(upright, "circle", { class: "plan-cursor-edge", r: 9 });
    const ring = draw(upright, "circle", { class: "plan-cursor", r: 9 });
    const dot = draw(draw(above, "g"), "circle", { class: "plan-dot", r: 2.5 });
    const gauge = draw(above, "g");
    const meter = draw(gauge, "g", { class: "plan-upright" });
    draw(meter, "circle", { class: "plan-gauge-back", r: 19 });
    const arc = draw(meter, "circle", {
      class: "plan-gauge",
      r: 19,
      pathLength: 100,
      transform: "rotate(-90)",
    });
    const action = draw(meter, "text", { class: "plan-action", "text-anchor": "middle", x: 0, y: -25 });
    const figure = {
      layers: [below, middle, above],
      unsure,
      body,
      torso,
      arm,
      name,
      nameAt,
      rayEdge,
      ray,
      cursor,
      ring,
      dot,
      gauge,
      arc,
      action,
      flag,
      proposal,
    };
    this.figures.set(user, figure);
    return figure;
  }

  private drawBody(figure: Figure, person: Person, isFresh: boolean, chosen: string): void {
    const stands = standingOf(person);
    for (const element of [figure.body, figure.nameAt, figure.arm, figure.unsure]) show(element, !!stands);
    if (!stands) return;
    const feet = stands.position_m;
    for (const element of [figure.body, figure.arm]) mark(element, "opacity", stands.isAssumed ? 0.5 : 1);
    const style = styleOf(person.profile);
    const yaw = facing(person, isFresh);
    mark(figure.body, "transform", `translate(${xy(feet)}) rotate(${turned(yaw)})`);
    mark(figure.nameAt, "transform", `translate(${xy([feet[0], feet[1] - 0.36])})`);
    mark(figure.name, "y", 10);
    write(
      figure.name,
      `${person.user}${person.user === chosen ? " (you)" : ""}${stands.isAssumed ? ": place to be found" : ""}`,
    );
    mark(figure.torso, "fill", style.isHollow ? "none" : style.color);
    mark(figure.torso, "stroke", style.isHollow ? style.color : "");
    const body = person.profile?.body ?? DEFAULT_BODY;
    const hand = person.profile?.hand ?? "right";
    const { origin_m: origin, direction } = (isFresh && person.cursor) || { origin_m: null, direction: null };
    const arm =
      origin && direction
        ? pointingArm(body, hand, feet, yaw, origin, direction)
        : hangingArm(body, hand, feet, yaw);
    mark(figure.arm, "d", path([arm.shoulder, arm.elbow, arm.finger]));
    const { major, minor, angle } = person.pose
      ? ellipseOf(person.pose.covariance)
      : { major: 0, minor: 0, angle: 0 };
    show(figure.unsure, major > 0.005);
    mark(figure.unsure, "rx", cm(major));
    mark(figure.unsure, "ry", cm(minor));
    mark(figure.unsure, "stroke", style.color);
    mark(figure.unsure, "fill", style.color);
    mark(figure.unsure, "transform", `translate(${xy(feet)}) rotate(${turned(angle)})`);
  }

  private drawRay(figure: Figure, person: Person, isFresh: boolean): void {
    const cursor = isFresh ? person.cursor : null;
    const origin = cursor?.origin_m;
    const direction = cursor?.direction;
    const point = cursor?.point_m ?? null;
    const end = point ?? (origin && direction ? rayEnd(origin, direction) : null);
    const style = styleOf(person.profile);
    for (const element of [figure.ray, figure.rayEdge]) {
      show(element, !!(origin && end));
      if (origin && end) mark(element, "d", path([origin, end]));
    }
    mark(figure.ray, "stroke", style.color);
    mark(figure.ray, "stroke-dasharray", style.dashes);
    mark(figure.ray, "opacity", point ? 1 : 0.45);
    const snapped = (isFresh && person.hover?.snapped_m) || point;
    show(figure.cursor, !!snapped);
    show(figure.dot, !!point);
    if (!snapped || !point) return;
    mark(figure.cursor, "transform", `translate(${xy(snapped)})`);
    mark(figure.ring, "stroke", style.color);
    mark(figure.ring, "stroke-dasharray", style.dashes);
    mark(figure.dot, "fill", style.color);
    mark(figure.dot.parentElement!, "transform", `translate(${xy(point)})`);
    if (!figure.dot.classList.contains("plan-upright")) figure.dot.classList.add("plan-upright");
  }

  private drawGoal({ flag, proposal }: Figure, site: Site, person: Person): void {
    const { color } = styleOf(person.profile);
    for (const [element, at] of [
      [flag, goalOf(site, person)?.position_m],
      [proposal, proposalOf(person)],
    ] as const) {
      show(element, !!at);
      if (at) mark(element, "transform", `translate(${xy(at)})`);
      mark(element, "stroke", color);
    }
  }

  private drawGauge(
    figure: Figure,
    person: Person,
    isFresh: boolean,
    packages: Packages,
    gauges: Map<string, number>,
  ): void {
    const hover = isFresh ? person.hover : null;
    const on = hover?.object_id ? packages.drawn.get(hover.object_id) : undefined;
    show(figure.gauge, !!hover && !!on);
    if (!hover || !on) return;
    const order = gauges.get(on.object.id) ?? 0;
    gauges.set(on.object.id, order + 1);
    const radius = 19 + 7 * order;
    mark(figure.gauge, "transform", `translate(${xy(on.at)})`);
    mark(figure.gauge.querySelector(".plan-gauge-back")!, "r", radius);
    mark(figure.arc, "r", radius);
    mark(figure.arc, "stroke", styleOf(person.profile).color);
    mark(figure.arc, "stroke-dasharray", `${(100 * hover.progress).toFixed(1)} 100`);
    mark(figure.action, "x", 22 * order);
    write(figure.action, hover.taken_by ? `× ${hover.taken_by}` : ACTIONS[hover.action]);
  }
}
