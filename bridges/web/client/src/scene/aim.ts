/** Where the mouse, a finger or the arrow keys point: a point in {W} on the surface below them. */

import * as THREE from "three";
import type { Read3, Vec3 } from "../geometry/vec";
import type { Beams } from "./beams";
import type { Marks } from "./marks";
import type { Picture } from "./picture";

/** A place so much nearer to the aim needs no line to it, m. */
const NEAR_M = 0.04;
/** Arrow keys: places are looked for below this height, m. */
const CEILING_M = 20;

/** Casts the pointer onto the scene; at most once a frame. */
export class Aim {
  on = false;
  /** Where it is aimed at; null: nowhere yet. */
  at: Vec3 | null = null;
  /** Where the pointer is, -1 to 1 from left to right and from below to above; null: not over the picture. */
  readonly pointer = new THREE.Vector2();
  isOver = false;
  /** The person does not point now: nothing shows where they did. */
  isResting = false;
  private pending = false;
  private readonly fingers = new Set<number>();
  private readonly caster = new THREE.Raycaster();
  private readonly hits: THREE.Intersection[] = [];
  private readonly normal = new THREE.Vector3();
  private readonly down = new THREE.Vector3(0, 0, -1);
  private readonly above = new THREE.Vector3();
  private isWall = false;
  private last: { x: number; y: number } | null = null;
  private readonly listeners = new AbortController();

  constructor(
    private readonly picture: Picture,
    private readonly wake: () => void,
    private readonly drag: (dx: number, dy: number) => void,
    /** The mouse has moved: whether that changes what is drawn while it does not aim. */
    private readonly hovers: () => boolean,
  ) {
    const { canvas } = picture;
    const { signal } = this.listeners;
    canvas.addEventListener(
      "pointerdown",
      (event) => {
        if (event.pointerType === "touch") this.fingers.add(event.pointerId);
        this.last = { x: event.clientX, y: event.clientY };
        this.moved(event);
      },
      { signal },
    );
    canvas.addEventListener("pointermove", (event) => this.moved(event), { signal });
    const ended = (event: PointerEvent) => {
      this.fingers.delete(event.pointerId);
      this.last = null;
      if (event.pointerType === "touch") this.isOver = false;
    };
    for (const name of ["pointerup", "pointercancel"] as const)
      window.addEventListener(name, ended, { signal });
    canvas.addEventListener(
      "pointerleave",
      () => {
        this.isOver = false;
        wake();
      },
      { signal },
    );
  }

  /** Where a mouse is over the picture, px from its upper left corner; null: nowhere. */
  get place(): readonly [number, number] | null {
    const { width, height } = this.picture;
    return this.isOver ? [((this.pointer.x + 1) / 2) * width, ((1 - this.pointer.y) / 2) * height] : null;
  }

  set(on: boolean): void {
    this.on = on;
    this.pending = this.isResting = false;
    if (!on) this.at = null;
    this.picture.canvas.style.cursor = on ? "crosshair" : "grab";
    this.wake();
  }

  private moved(event: PointerEvent): void {
    const isTouch = event.pointerType === "touch";
    const isDrag = isTouch ? this.fingers.size > 1 || !this.on : event.buttons !== 0;
    if (isDrag && this.last && (!isTouch || this.fingers.size < 3)) {
      this.drag(event.clientX - this.last.x, event.clientY - this.last.y);
      this.last = { x: event.clientX, y: event.clientY };
    }
    const box = this.picture.canvas.getBoundingClientRect();
    this.pointer.set(
      ((event.clientX - box.left) / box.width) * 2 - 1,
      1 - ((event.clientY - box.top) / box.height) * 2,
    );
    this.isOver = !isDrag;
    if (!this.on && this.hovers()) this.wake();
    if (!this.on || isDrag) return;
    this.pending = true;
    this.wake();
  }

  /** Cast if anything has changed; returns the new place. `turned`: the camera was moved by aiming itself. */
  tick(targets: (into: THREE.Object3D[]) => void, turned: boolean): Vec3 | null {
    if (!this.on || !(this.pending || (turned && this.isOver))) return null;
    this.pending = this.isResting = false;
    this.picture.camera.updateMatrixWorld();
    this.caster.setFromCamera(this.pointer, this.picture.camera);
    return this.cast(targets, true);
  }

  private cast(targets: (into: THREE.Object3D[]) => void, tellsWall: boolean): Vec3 | null {
    const list: THREE.Object3D[] = [];
    targets(list);
    this.hits.length = 0;
    this.caster.far = Infinity;
    const hit = this.caster.intersectObjects(list, false, this.hits)[0];
    if (!hit) return null;
    if (tellsWall) {
      this.normal.copy(hit.face?.normal ?? this.down).transformDirection(hit.object.matrixWorld);
      this.isWall = hit.object.userData.isSolid === true && Math.abs(this.normal.z) < 0.5;
    }
    this.at = [hit.point.x, hit.point.y, hit.point.z];
    return this.at;
  }

  /** Move the place on what it is on; on upright things away is up. @param start where to begin, if nowhere yet */
  nudge(right: number, away: number, start: Read3, targets: (into: THREE.Object3D[]) => void): Vec3 {
    this.isResting = false;
    const at: Vec3 = this.at ? [...this.at] : [...start];
    const { matrixWorld } = this.picture.camera;
    const e = matrixWorld.elements;
    const length = Math.hypot(e[0]!, e[1]!) || 1;
    const rx = e[0]! / length;
    const ry = e[1]! / length;
    at[0] += right * rx - (this.isWall ? 0 : away * ry);
    at[1] += right * ry + (this.isWall ? 0 : away * rx);
    if (this.isWall) {
      at[2] = Math.max(at[2] + away, 0);
      this.at = at;
    } else {
      this.at = at;
      this.caster.set(this.above.set(at[0], at[1], CEILING_M), this.down);
      this.cast(targets, false);
    }
    this.wake();
    return this.at;
  }

  /** The ghost: the aimed-at point, and its distance to the person's cursor. */
  mark(marks: Marks, beams: Beams, cursor: Read3 | null, dark: boolean): void {
    if (!this.on || !this.at || this.isResting) return;
    const color: Read3 = dark ? [255, 255, 255] : [25, 30, 38];
    marks.add(this.at, 0.045, color, { faces: true, thick: 0.2, alpha: 0.9 });
    marks.add(this.at, 0.012, color, { faces: true, thick: 0.9, alpha: 0.9 });
    if (!cursor) return;
    const apart = Math.hypot(cursor[0] - this.at[0], cursor[1] - this.at[1], cursor[2] - this.at[2]);
    if (apart > NEAR_M) beams.add(this.at, cursor, color, 0.7, 1.6, 0.06);
  }

  dispose(): void {
    this.listeners.abort();
  }
}
