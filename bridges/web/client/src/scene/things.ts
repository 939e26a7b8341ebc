/** What moves or reacts: packages on belts, segments on strips, boxes, robots; carried on to now in every frame. */

import * as THREE from "three";
import { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";
import type { TrackedObject, TrackedObjects } from "../messages";
import { cssColor, inkOn, isBox, kindColor, kindLetter, sizeOf, type Rgb } from "../geometry/appearance";
import { carriedOn, elapsed, LONGEST_S, type Placed } from "../geometry/motion";
import type { Polyline } from "../geometry/polyline";
import type { Vec3 } from "../geometry/vec";
import type { Site } from "../site/site";
import { setMatrix, type MeshFactory } from "./mesh_factory";
import { quadrotor } from "./robot_shapes";

type Form = "package" | "segment" | "box" | "robot";

/** One object and where it is in this frame. */
export interface Thing {
  object: TrackedObject;
  readonly form: Form;
  readonly placed: Placed;
  /** Length, width, height, m. */
  readonly size: Vec3;
  /** Its middle above its place on the surface, m. */
  readonly up: number;
  stamp_ns: number;
  line: Polyline | null;
}

interface Crowd {
  mesh: THREE.InstancedMesh;
  form: Form;
  kind: string;
  things: Thing[];
}

/** All tracked objects. */
export class Things {
  readonly byId = new Map<string, Thing>();
  private readonly crowds = new Map<string, Crowd>();
  private heard = new Map<string, TrackedObjects>();
  private readonly hull: THREE.InstancedMesh;
  private readonly edges: THREE.LineSegments[] = [];
  private readonly paint = new THREE.Color();

  constructor(
    private readonly factory: MeshFactory,
    private readonly lines: (surface: string, id: string) => Polyline | null,
  ) {
    this.hull = this.grown(
      "outline",
      new THREE.BoxGeometry(1, 1, 1),
      factory.plain(0xffffff, { side: THREE.BackSide }),
      128,
      "",
    );
    this.hull.count = 0;
  }

  /** What can be pointed at now. */
  targets(into: THREE.Object3D[]): void {
    for (const { mesh } of this.crowds.values()) {
      mesh.boundingSphere = null;
      if (mesh.count) into.push(mesh);
    }
  }

  /** Take the trackers' newest, without robots that have a state; returns whether anything is new. */
  set({ objects, robots }: Site): boolean {
    let isNew = objects.size !== this.heard.size;
    for (const [tracker, message] of objects) isNew ||= this.heard.get(tracker) !== message;
    if (!isNew) return false;
    this.heard = new Map(objects);
    const before = new Map(this.byId);
    this.byId.clear();
    for (const crowd of this.crowds.values()) crowd.things.length = 0;
    for (const message of objects.values()) {
      for (const object of message.objects) {
        if (robots.get(object.id)?.state) continue;
        const form = formOf(object);
        const line = this.lines(object.surface, object.surface_id);
        let thing = before.get(object.id);
        if (!thing || thing.form !== form || String(sizeOf(thing.object)) !== String(sizeOf(object)))
          thing = made(object, form);
        thing.object = object;
        thing.line = line;
        thing.stamp_ns = message.stamp_ns;
        this.byId.set(object.id, thing);
        this.crowd(form, object.kind).things.push(thing);
      }
    }
    return true;
  }

  /** Put everything where it is at `now_ns` of the site; returns whether anything goes on moving. */
  place(now_ns: number): boolean {
    let moves = false;
    for (const { mesh, form, things } of this.crowds.values()) {
      const room = mesh.instanceMatrix.count;
      let i = 0;
      for (const thing of things) {
        if (i >= room) break;
        const { object, placed, size } = thing;
        const seconds = elapsed(thing.stamp_ns, now_ns);
        carriedOn(object, seconds, thing.line, placed);
        const [vx, vy, vz] = object.velocity_mps;
        moves ||= seconds < LONGEST_S && (object.surface_speed_mps !== 0 || vx !== 0 || vy !== 0 || vz !== 0);
        const [x, y, z] = placed.at;
        const wide = form === "robot" ? size[0] : size[1];
        const tall = form === "robot" ? size[0] : size[2];
        setMatrix(mesh.instanceMatrix.array, i++, x, y, z + thing.up, placed.heading, size[0], wide, tall);
      }
      mesh.count = i;
      mesh.instanceMatrix.needsUpdate = true;
    }
    return moves;
  }

  /** In the viewer's own room boxes are seen by their edges, and hide what is behind them. */
  setImmersed(isImmersed: boolean): void {
    let used = 0;
    for (const { mesh, form, things } of this.crowds.values()) {
      if (form !== "box") continue;
      (mesh.material as THREE.Material).colorWrite = !isImmersed;
      mesh.renderOrder = isImmersed ? -1 : 0;
      for (const { placed, size, up } of isImmersed ? things : []) {
        const edge = (this.edges[used] ??= this.factory.edges());
        edge.position.set(placed.at[0], placed.at[1], placed.at[2] + up);
        edge.rotation.z = placed.heading;
        edge.scale.set(...size);
        used++;
      }
    }
    this.edges.forEach((edge, i) => (edge.visible = i < used));
  }

  /** Colour every box. */
  paintBoxes(colorOf: (thing: Thing) => Rgb): void {
    for (const { mesh, form, things } of this.crowds.values()) {
      if (form !== "box" || !things.length) continue;
      for (let i = 0; i < mesh.count; i++) mesh.setColorAt(i, this.painted(colorOf(things[i]!)));
      mesh.instanceColor!.needsUpdate = true;
    }
  }

  /** Draw an outline about things; `begin` first. */
  beginOutlines(): void {
    this.hull.count = 0;
  }

  private painted([r, g, b]: Rgb): THREE.Color {
    return this.paint.setRGB(r / 255, g / 255, b / 255, THREE.SRGBColorSpace);
  }

  outline(thing: Thing, color: Rgb): void {
    const i = this.hull.count;
    if (i >= this.hull.instanceMatrix.count || thing.form === "robot") return;
    const [x, y, z] = thing.placed.at;
    const [long, wide, tall] = thing.size;
    const rim = 0.026;
    setMatrix(
      this.hull.instanceMatrix.array,
      i,
      x,
      y,
      z + thing.up,
      thing.placed.heading,
      long + rim,
      wide + rim,
      tall + rim,
    );
    this.hull.setColorAt(i, this.painted(color));
    this.hull.count = i + 1;
  }

  endOutlines(): void {
    this.hull.instanceMatrix.needsUpdate = true;
    if (this.hull.instanceColor) this.hull.instanceColor.needsUpdate = true;
  }

  private crowd(form: Form, kind: string): Crowd {
    const key = `${form} ${kind}`;
    let crowd = this.crowds.get(key);
    const needed = crowd ? crowd.things.length + 1 : 1;
    if (crowd && needed <= crowd.mesh.instanceMatrix.count) return crowd;
    const room = Math.max(16, 2 * needed);
    const things = crowd?.things ?? [];
    crowd?.mesh.removeFromParent();
    crowd?.mesh.dispose();
    const mesh = this.grown(
      key,
      shapeOf(form),
      this.skin(form, kind),
      room,
      form === "segment" ? "" : "both",
    );
    crowd = { mesh, form, kind, things };
    this.crowds.set(key, crowd);
    return crowd;
  }

  private grown(
    name: string,
    geometry: THREE.BufferGeometry,
    material: THREE.Material,
    room: number,
    shadows: "" | "both",
  ): THREE.InstancedMesh {
    const mesh = this.factory.many(geometry, material, room, shadows);
    mesh.name = name;
    mesh.instanceMatrix.setUsage(THREE.DynamicDrawUsage);
    return mesh;
  }

  private skin(form: Form, kind: string): THREE.Material {
    const paint = kindColor(kind);
    const color = cssColor(paint);
    if (form === "robot") return this.factory.matt(0xffffff, { vertexColors: true, roughness: 0.45 });
    if (form === "box") return this.factory.matt(0xffffff);
    if (form === "segment")
      return this.factory.plain(color, { transparent: true, opacity: 0.34, depthWrite: false });
    const map = this.factory.texture(128, 128, (c) => {
      c.fillStyle = color;
      c.fillRect(0, 0, 128, 128);
      c.fillStyle = "rgba(255,255,255,.13)";
      c.fillRect(0, 52, 128, 24);
      c.strokeStyle = "rgba(0,0,0,.34)";
      c.lineWidth = 7;
      c.strokeRect(0, 0, 128, 128);
      c.fillStyle = inkOn(paint);
      c.font = "800 78px system-ui, sans-serif";
      c.textAlign = "center";
      c.textBaseline = "middle";
      c.fillText(kindLetter(kind), 64, 69);
    });
    return this.factory.matt(0xffffff, { map, roughness: 0.75 });
  }
}

function formOf(object: TrackedObject): Form {
  if (object.surface === "belt") return "package";
  if (isBox(object)) return "box";
  return object.surface === "strip" ? "segment" : "robot";
}

function made(object: TrackedObject, form: Form): Thing {
  const size = sizeOf(object);
  const up = form === "package" ? size[2] / 2 + 0.004 : form === "segment" ? 0.012 : 0;
  return {
    object,
    form,
    size,
    up,
    placed: { at: [...object.position_m], heading: 0, along: 0 },
    stamp_ns: 0,
    line: null,
  };
}

function shapeOf(form: Form): THREE.BufferGeometry {
  return form === "robot" ? quadrotor() : form === "box" ? new THREE.BoxGeometry(1, 1, 1) : lettered();
}

/** A box of 1 m without a bottom; its texture is upright on every side, and on top as seen from -y. */
function lettered(): THREE.BufferGeometry {
  const sides = [
    [0, -1],
    [1, 0],
    [0, 1],
    [-1, 0],
  ].map(([x, y]) =>
    new THREE.PlaneGeometry(1, 1)
      .rotateX(Math.PI / 2)
      .rotateZ(Math.atan2(x!, -y!))
      .translate(x! / 2, y! / 2, 0),
  );
  return mergeGeometries([...sides, new THREE.PlaneGeometry(1, 1).translate(0, 0, 0.5)]);
}
