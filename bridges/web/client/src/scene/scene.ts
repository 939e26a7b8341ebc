/** The 3-D scene: a view of the site; drawn when something has changed or moves, never else. */

import type * as THREE from "three";
import type { Separability } from "../geometry/separability";
import { aimsOf, boundsOf, cornersOf, pointsOf, type Bounds } from "../geometry/bounds";
import { larger, type Edges } from "../geometry/framing";
import type { Rect } from "../geometry/placing";
import type { Vec3 } from "../geometry/vec";
import type { Environment } from "../messages";
import { seenRobots } from "../site/robots";
import { siteNow, standingOf, type Site } from "../site/site";
import { darkLamps } from "../site/things";
import type { Camera, MakeView, View, ViewOptions, ViewStats } from "../view";
import { Aim } from "./aim";
import { drawSeparability, floorAt } from "./separability";
import { Cameras } from "./cameras";
import { Immersive } from "./immersive";
import { DARK, MeshFactory, LIGHT, type Theme } from "./mesh_factory";
import { Labels, NAME } from "./labels";
import { Names } from "./names";
import { People } from "./people";
import { Picture } from "./picture";
import { drawCounts, drawStates } from "./thing_states";
import { makeWorld, NOTHING, type World } from "./world";

/** Longer than this between two frames nothing has moved, s. */
const LONGEST_STEP_S = 0.25;
/** Without a graphics processor, frames between the site's own are left out while these come so often, ms. */
const OFTEN_MS = 60;

class Scene implements View {
  readonly cameras: readonly Camera[] = ["room", "top", "eyes"];
  private readonly picture: Picture;
  private readonly labels: Labels;
  private readonly camera: Cameras;
  private readonly aim: Aim;
  readonly immersion: Immersive;
  private readonly isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;
  private theme: Theme = DARK;
  private world: World | null = null;
  private names: Names | null = null;
  private overName = "";
  private separability: Separability | null = null;
  private site: Site | null = null;
  private mapVersion = -1;
  private posed = 0;
  private bounds: Bounds = boundsOf(NOTHING);
  private pointer = "";
  private asked = 0;
  private dirty = true;
  private moves = false;
  private drawnAt = 0;
  private toldAt = -Infinity;
  private siteAt = 0;
  private readonly targets = (into: THREE.Object3D[]): void => {
    if (!this.world) return;
    const { belts, strips, lamps, room, things, robots } = this.world;
    into.push(...room.targets, ...belts.targets, ...strips.targets, ...lamps.targets);
    things.targets(into);
    robots.targets(into);
  };

  constructor(
    host: HTMLElement,
    private readonly options: ViewOptions,
  ) {
    this.picture = new Picture(host, () => this.wake(), {
      away: () => {
        this.immersion.leave();
        this.tearDown();
      },
      back: () => {
        this.build(this.site?.map ?? NOTHING);
        this.wake();
      },
      lost: () => options.onLost(),
    });
    if (getComputedStyle(host).position === "static") host.style.position = "relative";
    this.labels = new Labels(host);
    this.camera = new Cameras(this.picture, this.isStill, () => this.wake());
    this.aim = new Aim(
      this.picture,
      () => this.wake(),
      (dx, dy) => {
        if (this.camera.mode === "eyes") this.camera.drag(dx, dy);
      },
      () => this.isOverAnother(),
    );
    this.aim.set(false);
    this.immersion = new Immersive(
      this.picture,
      () => this.site?.map ?? NOTHING,
      () => this.frame(performance.now()),
      options.arm,
      () => {
        if (this.asked > 0) this.asked = 0; // a headset may never give that frame
        this.wake();
        options.onImmersed();
      },
    );
    this.build(NOTHING);
  }

  get stats(): ViewStats {
    this.picture.measure(performance.now());
    return { ...this.picture.stats, lens: this.picture.lens, note: this.immersion.noteText };
  }

  draw(site: Site): void {
    const isFirst = !this.site;
    this.site = site;
    if (site.mapVersion !== this.mapVersion || isFirst) {
      this.mapVersion = site.mapVersion;
      this.build(site.map ?? NOTHING);
      this.posed = this.posedOf(site);
      const { low, high } = this.bounds;
      this.camera.frame(this.pointsOf(site), Math.hypot(high[0] - low[0], high[1] - low[1], high[2]));
    } else if (this.posed !== this.posedOf(site)) {
      this.posed = this.posedOf(site);
      this.camera.reframe(this.pointsOf(site));
    }
    this.dirty = true;
    this.toldAt = performance.now();
    // here and not in the frame's own turn, which may have been before the news came
    if (!this.picture.isImmersed) this.frame(this.toldAt);
  }

  /** What the camera shows: all that people point at, in a map without any its walls and floors; and the people. */
  private pointsOf(site: Site): Vec3[] {
    const map = site.map ?? NOTHING;
    const robots = seenRobots(site).map(({ state }) => state.position_m);
    const points = [aimsOf(map).concat(robots), pointsOf(map), cornersOf(this.bounds)].find(
      (each) => each.length,
    )!;
    return [...points, ...People.points(site)];
  }

  /** How many people and robots are to be seen. */
  private posedOf(site: Site): number {
    let count = seenRobots(site).length;
    for (const person of site.people.values()) if (standingOf(person)) count++;
    return count;
  }

  setTheme(dark: boolean): void {
    if (this.theme.dark === dark) return;
    this.theme = dark ? DARK : LIGHT;
    this.build(this.site?.map ?? NOTHING);
    this.wake();
  }

  setSeparability(separability: Separability | null): void {
    if (this.separability === separability) return;
    this.separability = separability;
    this.build(this.site?.map ?? NOTHING);
    this.wake();
  }

  floorAt(x: number, y: number): [number, number] | null {
    return floorAt(this.picture, x, y);
  }

  setCamera(camera: Camera, user: string): void {
    const direction = this.site?.people.get(user)?.cursor?.direction;
    if (camera === "eyes" && direction && (this.camera.mode !== "eyes" || this.camera.user !== user))
      this.camera.face(direction);
    this.camera.set(camera, user);
    this.camera.setPointing(this.aim.on);
    this.wake();
  }

  keepClear(covered: readonly Rect[], edges: Edges): void {
    // who points needs a camera that stands still: it gives way to a card that has grown, and stays there
    this.camera.keepClear(this.aim.on ? larger(this.camera.edges, edges) : edges);
    if (JSON.stringify(covered) === JSON.stringify(this.labels.covered)) return;
    this.labels.covered = covered;
    this.wake();
  }

  setPointing(on: boolean, user: string): void {
    this.pointer = user;
    this.aim.set(on);
    this.camera.setPointing(on);
  }

  nudge(right: number, away: number): void {
    if (!this.aim.on) return;
    const { low, high } = this.bounds;
    const start = this.site?.people.get(this.pointer)?.cursor?.point_m ?? [
      (low[0] + high[0]) / 2,
      (low[1] + high[1]) / 2,
      0,
    ];
    this.options.onAim(this.aim.nudge(right, away, start, this.targets));
  }

  pointAt(at: Vec3): void {
    this.aim.at = at;
    this.aim.isResting = false;
    this.wake();
  }

  placeOf(id: string): Vec3 | null {
    const lamp = this.site?.map?.lamps.find((each) => each.id === id);
    const robot = this.world?.robots.places.get(id);
    const thing = this.world?.things.byId.get(id);
    const at = lamp?.position_m ?? robot;
    return at
      ? [...at]
      : thing
        ? [thing.placed.at[0], thing.placed.at[1], thing.placed.at[2] + thing.up]
        : null;
  }

  rest(): void {
    this.aim.isResting = true;
    this.wake();
  }

  private tearDown(): void {
    this.world?.people.dispose();
    this.world?.factory.dispose();
    this.world = null;
  }

  private build(map: Environment): void {
    this.tearDown();
    this.bounds = boundsOf(map);
    if (this.picture.isLost) return;
    const factory = new MeshFactory(this.picture.stats.software, this.theme);
    this.world = makeWorld(factory, map, this.bounds, this.labels, this.isStill);
    this.names = new Names(map);
    if (this.separability) drawSeparability(factory, this.separability);
    this.picture.light(this.theme, this.bounds);
    this.picture.scene.add(factory.group);
    this.dirty = true;
  }

  /** Have a frame drawn. */
  private wake(): void {
    this.dirty = true;
    this.ask();
  }

  private ask(): void {
    if (!this.asked) this.asked = requestAnimationFrame(() => this.turn());
  }

  private turn(): void {
    this.asked = 0;
    const now = performance.now();
    if (this.picture.stats.software && now - this.toldAt < OFTEN_MS && !this.dirty) this.ask();
    else if ((this.dirty || this.moves) && !this.picture.isImmersed) this.frame(now); // a session has frames of its own
  }

  private frame(now: number): void {
    const { world, picture } = this;
    const { isImmersed } = picture;
    if (!world || picture.isLost) return;
    world.room.setImmersed(isImmersed);
    world.factory.group.visible = !isImmersed || this.immersion.isAligned;
    const seconds = Math.min((now - this.drawnAt) / 1000, LONGEST_STEP_S);
    this.drawnAt = now;
    this.dirty = false;
    const chosen = this.site?.people.get(this.camera.user);
    const isAiming = this.aim.on && this.aim.isOver;
    const turned =
      !isImmersed &&
      this.camera.tick(
        now,
        seconds,
        People.eyes(chosen),
        this.aim.isResting ? null : (chosen?.cursor?.direction ?? null),
        isAiming ? [this.aim.pointer.x, this.aim.pointer.y] : null,
      );
    picture.camera.updateMatrixWorld();
    this.moves = turned;
    world.marks.begin(picture.pixel);
    world.beams.begin(...picture.size);
    this.labels.begin(this.theme);
    if (this.site) this.moves = this.show(this.site, world, now, seconds) || this.moves;
    const at = isImmersed ? null : this.aim.tick(this.targets, turned && this.camera.mode === "eyes");
    this.aim.mark(
      world.marks,
      world.beams,
      this.site?.people.get(this.pointer)?.cursor?.point_m ?? null,
      this.theme.dark,
    );
    world.marks.end();
    world.beams.end();
    if (isImmersed) this.immersion.show(this.labels.texts, this.theme);
    this.labels.end(picture.camera, picture.width, picture.height);
    picture.render(now, this.moves, this.camera.distance);
    if (this.moves || this.dirty) this.ask();
    if (at) this.options.onAim(at);
  }

  /** Everything of the site as of now; returns whether anything goes on moving. */
  private show(site: Site, world: World, now: number, seconds: number): boolean {
    const now_ns = siteNow(site);
    const passed = Math.min(Math.max((now_ns - this.siteAt) / 1e9, 0), LONGEST_STEP_S * site.speed);
    this.siteAt = now_ns;
    world.belts.set(site.conveyor);
    world.strips.set(site.strips);
    world.lamps.set(site.lamps, this.theme.dark, darkLamps(site));
    world.lamps.mark(world.marks);
    const { camera, width, height } = this.picture;
    for (const { key, at, up, text } of this.names?.shown(
      site,
      this.aim.place,
      camera,
      width,
      height,
      this.picture.isImmersed,
    ) ?? [])
      this.labels.add(key, at, up, [{ text }], "", NAME);
    world.things.set(site);
    let moves = world.things.place(now_ns);
    for (const { object, placed, size, up } of world.things.byId.values()) {
      this.labels.keepFree(
        [placed.at[0], placed.at[1], placed.at[2] + up],
        Math.max(size[0], size[1]),
        Math.min(size[0], size[1]),
        size[2],
        `thing ${object.id}`,
      );
    }
    if (site.connected) moves = world.belts.run(passed) || moves;
    const at = site.speed ? now : this.toldAt; // nobody grows old in a past that is paused
    moves =
      world.people.draw(
        site,
        at,
        seconds,
        this.picture.isImmersed
          ? this.options.arm.pointing
          : this.camera.mode === "eyes"
            ? this.camera.user
            : "",
        this.immersion.viewerAt,
      ) || moves;
    moves = world.robots.draw(site) || moves;
    world.things.setImmersed(this.picture.isImmersed);
    const { things, marks } = world;
    drawStates(site, { things, marks, labels: this.labels, isDark: world.factory.theme.dark });
    drawCounts(site, world.bays, this.labels);
    return moves;
  }

  /** Whether the mouse has come over something else with a name. */
  private isOverAnother(): boolean {
    const { camera, width, height } = this.picture;
    const { place } = this.aim;
    const key = (place && this.names?.hovered(place, camera, width, height)?.key) ?? "";
    const isAnother = key !== this.overName;
    this.overName = key;
    return isAnother;
  }

  dispose(): void {
    cancelAnimationFrame(this.asked);
    this.asked = -1;
    this.immersion.leave();
    this.aim.dispose();
    this.camera.dispose();
    this.tearDown();
    this.labels.dispose();
    this.picture.dispose();
  }
}

/** Makes the 3-D scene within `host`. @throws Error with one sentence where there is no WebGL. */
export const makeScene: MakeView = (host, options) => new Scene(host, options);
