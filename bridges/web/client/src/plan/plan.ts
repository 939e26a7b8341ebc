/** The plan: the site from above as SVG, for browsers without WebGL and for everybody who prefers it. */

import { mark, write } from "../dom";
import "./plan.css";
import { seenRobots } from "../site/robots";
import { standingOf, type Site } from "../site/site";
import type { Camera, MakeView, View, ViewOptions, ViewStats } from "../view";
import type { Separability } from "../geometry/separability";
import { boundsOf } from "../geometry/bounds";
import type { Vec3 } from "../geometry/vec";
import { Frame, grown, scaleBar } from "./frame";
import { Gestures } from "./gestures";
import { drawFences } from "./fences";
import { drawSeparability, drawBays, drawBelts, drawFloor, drawSolids } from "./ground";
import { Lanes } from "./lanes";
import { Lights } from "./lights";
import { Packages } from "./packages";
import { People } from "./people";
import { drawPlaces } from "./places";
import { Robots } from "./robots";
import { draw, show, xy } from "./svg";
import { pointedPosition } from "./pointed_position";

/** Texts that grow or move are kept inside the plan so often, ms. */
const CHECK_MS = 1000;
/** Distance of a text from the plan's edge, px. */
const EDGE_PX = 6;
/** The pointer snaps to a lamp or strip within this distance, px. */
const NEAR_PX = 10;
const LAYERS = [
  "apart",
  "ground",
  "fences",
  "belts",
  "bays",
  "floor",
  "packages",
  "strips",
  "lamps",
  "bodies",
  "letters",
  "top",
  "aim",
] as const;

class Plan implements View {
  readonly stats: ViewStats = { fps: 0, renderer: "SVG", software: false, lens: [] };
  readonly cameras: readonly Camera[] = ["top"];
  private readonly box = document.createElement("div");
  private readonly svg: SVGSVGElement;
  private readonly world: SVGGElement;
  private readonly layers: Record<(typeof LAYERS)[number], SVGGElement>;
  private readonly bar: { line: SVGElement; text: SVGTextElement };
  private readonly frame = new Frame();
  private readonly gestures: Gestures;
  private readonly packages: Packages;
  private readonly people: People;
  private readonly robots: Robots;
  private readonly sized: ResizeObserver;
  private lanes = new Lanes(null);
  private lights: Lights | null = null;
  private counts = new Map<string, SVGTextElement>();
  private site: Site | null = null;
  private mapVersion = -1;
  /** Everything is shown, until the person moves the plan. */
  private isFitted = true;
  /** People and robots that are seen. */
  private shown = "";
  private isPointing = false;
  private user = "";
  private aim: Vec3 | null = null;
  private drawnAt: number[] = [];
  private checkedAt = -Infinity;

  constructor(
    host: HTMLElement,
    private readonly options: ViewOptions,
  ) {
    this.box.className = "plan";
    this.svg = draw(this.box, "svg", {
      class: "plan-map",
      tabindex: 0,
      role: "img",
      "aria-label":
        "Plan of the room from above; the list below has the same as text. Plus and minus zoom, 0 shows everything.",
    });
    this.world = draw(this.svg, "g");
    this.layers = Object.fromEntries(
      LAYERS.map((name) => [name, draw(this.world, "g", { class: `plan-layer-${name}` })]),
    ) as typeof this.layers;
    const bar = draw(this.svg, "g", { class: "plan-scale" });
    this.bar = { line: draw(bar, "path", {}), text: draw(bar, "text", { x: 14 }) };
    const cross = draw(this.layers.aim, "g", { class: "plan-upright" });
    draw(cross, "path", { class: "plan-cross-edge", d: "M-14 0H-4M4 0H14M0 -14V-4M0 4V14" });
    draw(cross, "path", { class: "plan-cross", d: "M-14 0H-4M4 0H14M0 -14V-4M0 4V14" });
    show(this.layers.aim, false);
    this.packages = new Packages(this.layers.packages, this.layers.letters);
    this.people = new People(this.layers.floor, this.layers.bodies, this.layers.top);
    this.robots = new Robots(this.layers.floor, this.layers.bodies, this.layers.top);
    host.append(this.box);
    this.gestures = new Gestures(this.svg, this.frame, {
      moved: () => this.moved(),
      points: (x, y) => this.pointAtPixel(x, y),
      fit: () => this.fit(),
    });
    this.sized = new ResizeObserver(() => this.resize());
    this.sized.observe(this.svg);
    this.resize();
  }

  draw(site: Site): void {
    this.site = site;
    if (site.mapVersion !== this.mapVersion) this.rebuild(site);
    const who = [
      ...[...site.people.values()].filter(standingOf).map(({ user }) => user),
      ...site.robots.keys(),
    ].join(" ");
    if (who !== this.shown) {
      this.shown = who;
      if (this.isFitted) this.fit();
    }
    this.packages.update(site, this.lanes);
    this.lights?.update(site);
    this.people.update(site, this.packages, this.isPointing ? this.user : "");
    this.robots.update(site);
    this.count(site);
    const now = performance.now();
    if (now - this.checkedAt > CHECK_MS) this.keepInside();
    this.drawnAt.push(now);
    while (this.drawnAt[0]! < now - 1000) this.drawnAt.shift();
    this.stats.fps = this.drawnAt.length;
  }

  setTheme(dark: boolean): void {
    this.box.classList.toggle("plan-dark", dark);
  }

  setSeparability(separability: Separability | null): void {
    this.layers.apart.replaceChildren();
    if (separability) drawSeparability(this.layers.apart, separability);
  }

  floorAt(x: number, y: number): readonly [number, number] {
    const { left, top } = this.svg.getBoundingClientRect();
    return this.frame.toWorld(x - left, y - top);
  }

  setCamera(_camera: Camera, _user: string): void {
    this.fit();
  }

  setPointing(on: boolean, user: string): void {
    this.isPointing = this.gestures.pointing = on;
    this.user = user;
    this.svg.classList.toggle("plan-pointing", on);
    if (!on) {
      this.aim = null;
      show(this.layers.aim, false);
    }
  }

  nudge(right: number, away: number): void {
    if (!this.isPointing) return;
    const cursor = this.site?.people.get(this.user)?.cursor?.point_m;
    const from = this.aim ?? cursor ?? [this.frame.x, this.frame.y, 0];
    this.aimAt(
      pointedPosition(
        this.site?.map ?? null,
        this.lanes,
        this.packages.drawn.values(),
        from[0] + right,
        from[1] + away,
        0.02,
      ),
    );
  }

  pointAt(at: Vec3): void {
    this.aim = at;
    mark(this.layers.aim, "transform", `translate(${xy(at)})`);
    show(this.layers.aim, true);
  }

  placeOf(id: string): Vec3 | null {
    const lamp = this.site?.map?.lamps.find((each) => each.id === id);
    const at = lamp?.position_m ?? this.robots.places.get(id) ?? this.packages.drawn.get(id)?.at;
    return at ? [...at] : null;
  }

  rest(): void {
    show(this.layers.aim, false);
  }

  dispose(): void {
    this.gestures.dispose();
    this.sized.disconnect();
    this.box.remove();
  }

  private rebuild(site: Site): void {
    this.mapVersion = site.mapVersion;
    this.lanes = new Lanes(site.map);
    for (const name of ["ground", "fences", "belts", "bays", "strips", "lamps"] as const)
      this.layers[name].replaceChildren();
    this.packages.clear();
    this.lights = null;
    if (!site.map) return;
    drawFloor(this.layers.ground, boundsOf(site.map));
    drawSolids(this.layers.ground, site.map);
    drawFences(this.layers.fences, site.map);
    drawPlaces(this.layers.fences, site.map);
    drawBelts(this.layers.belts, site.map, this.lanes);
    this.counts = drawBays(this.layers.bays, site.map, this.lanes);
    this.lights = new Lights(this.layers.strips, this.layers.lamps, site.map, this.lanes);
    this.fit();
  }

  private count(site: Site): void {
    for (const [bay, text] of this.counts) {
      const kinds = (site.conveyor?.bays ?? []).filter((each) => each.bay === bay && each.count > 0);
      write(
        text,
        kinds
          .map(({ kind, count, selected }) => `${count} ${kind}${selected ? ` (${selected} selected)` : ""}`)
          .join(", ") || "empty",
      );
    }
  }

  private pointAtPixel(px: number, py: number): void {
    const [x, y] = this.frame.toWorld(px, py);
    this.aimAt(
      pointedPosition(
        this.site?.map ?? null,
        this.lanes,
        this.packages.drawn.values(),
        x,
        y,
        NEAR_PX / this.frame.scale,
      ),
    );
  }

  private aimAt(at: Vec3): void {
    this.pointAt(at);
    this.options.onAim(at);
  }

  private fit(): void {
    const people = [...(this.site?.people.values() ?? [])].flatMap((person) => {
      const stands = standingOf(person);
      return stands ? [stands.position_m] : [];
    });
    const robots = this.site ? seenRobots(this.site).map(({ state }) => state.position_m) : [];
    if (this.site?.map)
      this.frame.fit(
        grown(boundsOf(this.site.map), [...people, ...robots]),
        Math.min(70, this.frame.width * 0.16),
      );
    this.isFitted = true;
    this.apply();
  }

  private moved(): void {
    this.isFitted = false;
    this.apply();
  }

  private resize(): void {
    const { width, height } = this.svg.getBoundingClientRect();
    if (!width || !height) return;
    [this.frame.width, this.frame.height] = [width, height];
    if (this.isFitted) this.fit();
    else this.apply();
  }

  /** Move texts that reach over the edge of the plan, but not what is out of sight, into it. */
  private keepInside(): void {
    this.checkedAt = performance.now();
    const edge = this.svg.getBoundingClientRect();
    const texts = [...this.world.querySelectorAll("text")];
    const moves = texts.map((text) => {
      const { left, right } = text.getBoundingClientRect();
      const before = parseFloat(text.style.translate) || 0;
      if (left - before > edge.right || right - before < edge.left) return 0;
      return (
        Math.max(edge.left + EDGE_PX - (left - before), 0) +
        Math.min(edge.right - EDGE_PX - (right - before), 0)
      );
    });
    texts.forEach((text, i) => {
      const translate = moves[i] ? `${Math.round(moves[i])}px` : "";
      if (text.style.translate !== translate) text.style.translate = translate;
    });
  }

  private apply(): void {
    const { frame } = this;
    mark(this.world, "transform", frame.transform);
    this.svg.style.setProperty("--plan-px", String(100 / frame.scale));
    this.layers.strips.setAttribute("stroke-width", String(Math.max(2.4, 300 / frame.scale)));
    this.svg.classList.toggle("plan-near", frame.scale > 250);
    this.svg.classList.toggle("plan-far", frame.scale < 60);
    this.keepInside();
    const metres = scaleBar(frame.scale);
    const y = frame.height - 16;
    mark(this.bar.line, "d", `M14 ${y - 5}V${y}H${14 + metres * frame.scale}V${y - 5}`);
    mark(this.bar.text, "y", y - 9);
    write(this.bar.text, metres < 1 ? `${metres * 100} cm` : `${metres} m`);
  }
}

/** Makes the plan within `host`; needs nothing but SVG. */
export const makePlan: MakeView = (host, options) => new Plan(host, options);
