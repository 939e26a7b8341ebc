/** Robots that people steer, in the plan: heading, height, what is left of their way, and whose they are. */

import { mark, write } from "../dom";
import type { RobotState } from "../messages";
import { heightOf, meantBy, phaseOf, robotAt, seenRobots, wayOf, type SeenRobot } from "../site/robots";
import { siteNow, type Person, type Site } from "../site/site";
import type { Vec3 } from "../geometry/vec";
import { styleOf } from "./person_style";
import { cm, draw, path, show, turned, xy } from "./svg";

/** The shadow lies so far to the lower right of a robot, as a share of its height. */
const SHADOW = 0.35;
/** A robot is drawn this large at least: half its size, px. */
const LEAST_PX = 11;

interface Figure {
  readonly kind: RobotState["kind"];
  readonly layers: readonly Element[];
  readonly shadow: SVGElement;
  readonly drop: SVGElement;
  readonly wayEdge: SVGElement;
  readonly way: SVGElement;
  readonly target: SVGElement;
  readonly place: SVGGElement;
  readonly glyph: SVGGElement;
  readonly ring: SVGElement;
  readonly nameAt: SVGGElement;
  readonly name: SVGTextElement;
  readonly note: SVGTextElement;
}

export class Robots {
  /** Where each is in this frame, {W}. */
  readonly places = new Map<string, Vec3>();
  private readonly figures = new Map<string, Figure>();
  private readonly routes = new Map<string, { group: SVGGElement; drawn: string }>();

  /** Layers of the plan: on the floor, bodies, and above everything. */
  constructor(
    private readonly floor: Element,
    private readonly bodies: Element,
    private readonly top: Element,
  ) {}

  update(site: Site): void {
    const now_ns = siteNow(site);
    const seen = seenRobots(site);
    this.places.clear();
    for (const robot of seen) {
      const at = robotAt(robot.state, now_ns);
      this.places.set(robot.name, at);
      this.one(site, robot, at);
    }
    for (const [name, { layers }] of this.figures) {
      if (this.places.has(name)) continue;
      for (const layer of layers) layer.remove();
      this.figures.delete(name);
    }
    for (const person of site.people.values()) this.waypoints(person);
    for (const [user, { group }] of this.routes) {
      if (site.people.has(user)) continue;
      group.remove();
      this.routes.delete(user);
    }
  }

  private one(site: Site, robot: SeenRobot, at: Vec3): void {
    const { name, state } = robot;
    const figure = this.figure(name, state.kind);
    const style = styleOf(site.people.get(state.user)?.profile);
    const color = state.user ? style.color : "var(--quiet)";
    const height = Math.max(at[2], 0);
    const isFlying = state.kind === "quadrotor" && height >= 0.05;
    const below: Vec3 = [at[0] + SHADOW * height, at[1] - SHADOW * height, 0];
    for (const element of [figure.shadow, figure.drop]) show(element, isFlying);
    mark(figure.shadow, "transform", `translate(${xy(below)})`);
    mark(figure.shadow, "r", cm(state.radius_m));
    mark(figure.drop, "d", path([at, below]));
    const way = wayOf(robot, at);
    for (const element of [figure.way, figure.wayEdge]) {
      show(element, way.length > 1);
      mark(element, "d", path(way));
    }
    mark(figure.way, "stroke", color);
    show(figure.target, !!state.target_m);
    if (state.target_m) mark(figure.target, "transform", `translate(${xy(state.target_m)})`);
    mark(figure.target, "r", cm(state.radius_m));
    mark(figure.target, "stroke", color);
    mark(figure.place, "transform", `translate(${xy(at)}) rotate(${turned(state.yaw_rad)})`);
    mark(figure.place, "opacity", state.phase === "lost" ? 0.45 : 1);
    figure.glyph.style.setProperty("--half", String(cm(state.radius_m)));
    figure.glyph.style.setProperty("--least", String(LEAST_PX));
    mark(figure.ring, "stroke", color);
    mark(figure.ring, "stroke-dasharray", state.user ? style.dashes : "none");
    mark(figure.nameAt, "transform", `translate(${xy([at[0], at[1] + state.radius_m])})`);
    write(figure.name, state.user ? `${name} · ${state.user}` : name);
    const meant = meantBy(site, name).map(
      ({ user, probability }) => `${user} ${Math.round(100 * probability)} %`,
    );
    write(
      figure.note,
      [phaseOf(state), isFlying ? heightOf(state) : "", ...meant].filter(Boolean).join(" · "),
    );
  }

  /** Way-points that are set and not yet sent, numbered. */
  private waypoints({ user, steering, profile }: Person): void {
    const points = steering?.waypoints_m ?? [];
    const style = styleOf(profile);
    const drawn = JSON.stringify([points, style.color]);
    let route = this.routes.get(user);
    if (!route) this.routes.set(user, (route = { group: draw(this.top, "g"), drawn: "[]" }));
    if (route.drawn === drawn) return;
    route.drawn = drawn;
    route.group.replaceChildren();
    if (points.length > 1)
      draw(route.group, "path", { class: "plan-way", d: path(points), stroke: style.color });
    points.forEach((point, i) => {
      const upright = draw(draw(route.group, "g", { transform: `translate(${xy(point)})` }), "g", {
        class: "plan-upright",
      });
      draw(upright, "circle", { class: "plan-way-point", r: 9, stroke: style.color });
      draw(upright, "text", { class: "plan-owner", "text-anchor": "middle", y: 4.5 }, String(i + 1));
    });
  }

  private figure(name: string, kind: RobotState["kind"]): Figure {
    const before = this.figures.get(name);
    if (before?.kind === kind) return before;
    for (const layer of before?.layers ?? []) layer.remove();
    const below = draw(this.floor, "g");
    const middle = draw(this.bodies, "g");
    const above = draw(this.top, "g");
    const shadow = draw(below, "circle", { class: "plan-shadow" });
    const drop = draw(below, "path", { class: "plan-drop" });
    const wayEdge = draw(below, "path", { class: "plan-way-edge" });
    const way = draw(below, "path", { class: "plan-way" });
    const target = draw(below, "circle", { class: "plan-way-target" });
    const place = draw(middle, "g");
    const glyph = draw(place, "g", { class: "plan-robot" });
    draw(glyph, "circle", { class: "plan-robot-edge", r: 1.35 });
    const ring = draw(glyph, "circle", { class: "plan-robot-ring", r: 1.35 });
    if (kind === "quadrotor") {
      draw(glyph, "path", { class: "plan-robot-arms", d: "M-.6 -.6L.6 .6M-.6 .6L.6 -.6" });
      for (const x of [-0.6, 0.6])
        for (const y of [-0.6, 0.6])
          draw(glyph, "circle", {
            class: x > 0 ? "plan-rotor plan-front" : "plan-rotor",
            cx: x,
            cy: y,
            r: 0.36,
          });
      draw(glyph, "path", { class: "plan-robot-nose", d: "M.62 0L.1 -.3V.3Z" });
    } else {
      for (const y of [-1, 0.7])
        draw(glyph, "rect", { class: "plan-wheel", x: -0.4, y, width: 0.8, height: 0.3 });
      draw(glyph, "circle", { class: "plan-chassis", r: 0.78 });
      draw(glyph, "path", { class: "plan-robot-nose", d: "M.7 0L.05 -.42V.42Z" });
    }
    const nameAt = draw(above, "g");
    const upright = draw(nameAt, "g", { class: "plan-upright" });
    const label = (className: string, y: number) =>
      draw(upright, "text", { class: className, "text-anchor": "middle", y });
    const figure = {
      kind,
      layers: [below, middle, above],
      shadow,
      drop,
      wayEdge,
      way,
      target,
      place,
      glyph,
      ring,
      nameAt,
      name: label("plan-person", -27),
      note: label("plan-note plan-robot-note", -13),
    };
    this.figures.set(name, figure);
    return figure;
  }
}
