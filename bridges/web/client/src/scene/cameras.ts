/** From where the scene is seen: the room, from above, through a person's eyes; and how one gets there. */

import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { framed, NO_EDGES, type Edges } from "../geometry/framing";
import { unit, wrapped, type Read3, type Vec3 } from "../geometry/vec";
import type { Camera } from "../view";
import type { Picture } from "./picture";

const ROOM_ALONG = unit([0.34, 0.8, -0.62]);
/** Along which a room is seen that is longer in y than in x. */
const DEEP_ALONG = unit([-0.8, 0.34, -0.62]);
/** By how much longer. */
const DEEP = 1.6;
const ABOVE_ALONG = unit([0, 0.0002, -1]);
/** From above almost without perspective. */
const FOV = { room: 42, top: 12, eyes: 68 } as const;
const WAY_MS = 850;
/** Radians for a pixel of dragging in the first person's view. */
const DRAG_RAD = 0.0042;
/** Beyond this share of the picture from its middle, aiming turns the head; at the edge by so much, rad/s. */
const STILL_SHARE = 0.45;
const TURN_RADPS = 1.3;
const FOLLOW_PER_S = 3;
/** Who lets the arm hang does not look at their feet. */
const LOWEST_RAD = -0.55;

interface Pose {
  position: THREE.Vector3;
  target: THREE.Vector3;
  fov: number;
}

const posed = (): Pose => ({ position: new THREE.Vector3(), target: new THREE.Vector3(), fov: 42 });

/** The camera and its control. */
export class Cameras {
  mode: Camera = "room";
  user = "";
  private readonly controls: OrbitControls;
  private readonly from = posed();
  private readonly to = posed();
  private readonly kept = new Map<Camera, Pose>();
  private points: readonly Read3[] = [[0, 0, 0]];
  private began = -Infinity;
  private onWay = false;
  /** Nobody has moved the camera since it was framed. */
  private isFramed = true;
  private aspect = 0;
  /** Covered parts of the picture, px. */
  edges = NO_EDGES;
  private yaw = 0;
  private pitch = -0.3;

  constructor(
    private readonly picture: Picture,
    private readonly isStill: boolean,
    private readonly wake: () => void,
  ) {
    this.controls = new OrbitControls(picture.camera, picture.canvas);
    this.controls.enableDamping = !isStill;
    this.controls.dampingFactor = 0.14;
    this.controls.zoomToCursor = true;
    this.controls.minDistance = 0.7;
    this.controls.maxPolarAngle = 1.52;
    this.controls.addEventListener("change", wake);
    this.controls.addEventListener("start", () => {
      this.isFramed = false;
      this.onWay = false;
    });
  }

  /** Fingers: one aims while pointing, else it turns; two turn and zoom. */
  setPointing(on: boolean): void {
    this.controls.touches.ONE = on ? null : this.mode === "top" ? THREE.TOUCH.PAN : THREE.TOUCH.ROTATE;
    this.controls.touches.TWO = this.mode === "top" || !on ? THREE.TOUCH.DOLLY_PAN : THREE.TOUCH.DOLLY_ROTATE;
  }

  /** Fit the view to a changed scene, unless the user has moved the camera. */
  reframe(points: readonly Read3[]): void {
    this.points = points;
    if (this.isFramed && this.mode !== "eyes") this.go(performance.now(), this.isStill);
  }

  /** Frame between `edges`, px, what is shown: at once if less is free than before, else gently. */
  keepClear(edges: Edges): void {
    const { top, bottom } = this.edges;
    if (edges.top === top && edges.bottom === bottom) return;
    this.edges = edges;
    if (this.isFramed && this.mode !== "eyes")
      this.go(performance.now(), this.isStill || edges.top > top || edges.bottom > bottom);
  }

  /** Show all `points`, {W}, at once; `size`: how far they are apart at most, m. */
  frame(points: readonly Read3[], size: number): void {
    this.points = points;
    this.kept.clear();
    this.controls.maxDistance = 8 * size + 20;
    this.isFramed = true;
    this.go(performance.now(), true);
  }

  set(mode: Camera, user: string): void {
    if (mode === this.mode && user === this.user) return;
    const before = this.mode;
    this.user = user;
    if (mode === before && mode !== "eyes") return;
    if (before !== "eyes" && !this.isFramed) {
      this.kept.set(before, {
        position: this.picture.camera.position.clone(),
        target: this.controls.target.clone(),
        fov: FOV[before],
      });
    }
    this.mode = mode;
    this.isFramed = !this.kept.has(mode);
    this.go(performance.now(), this.isStill);
  }

  /** Look where this person points, to begin with. */
  face(direction: Read3): void {
    this.yaw = Math.atan2(direction[1], direction[0]);
    this.pitch = Math.asin(Math.max(-1, Math.min(1, direction[2])));
  }

  /** Turn the head by a drag, px. */
  drag(dx: number, dy: number): void {
    this.yaw += dx * DRAG_RAD;
    this.pitch = Math.min(Math.max(this.pitch + dy * DRAG_RAD, -1.4), 1.2);
    this.wake();
  }

  /** Distance of the camera's target, m. */
  get distance(): number {
    return this.picture.camera.position.distanceTo(this.controls.target);
  }

  private get isDeep(): boolean {
    const low = [Infinity, Infinity];
    const high = [-Infinity, -Infinity];
    for (const point of this.points) {
      for (const axis of [0, 1] as const) {
        low[axis] = Math.min(low[axis]!, point[axis]);
        high[axis] = Math.max(high[axis]!, point[axis]);
      }
    }
    return high[1]! - low[1]! > DEEP * (high[0]! - low[0]!);
  }

  private go(now: number, atOnce: boolean): void {
    const { camera } = this.picture;
    this.from.position.copy(camera.position);
    this.from.target.copy(this.controls.target);
    this.from.fov = camera.fov;
    this.began = now;
    this.onWay = true;
    const isTop = this.mode === "top";
    this.controls.enabled = this.mode !== "eyes";
    this.controls.enableRotate = !isTop;
    this.controls.screenSpacePanning = isTop;
    this.controls.mouseButtons.LEFT = isTop ? THREE.MOUSE.PAN : THREE.MOUSE.ROTATE;
    if (atOnce) this.began = -Infinity;
    this.aim();
    this.wake();
  }

  /** Where the way leads to. */
  private aim(): void {
    const kept = this.kept.get(this.mode);
    this.to.fov = FOV[this.mode];
    if (this.mode === "eyes") return;
    if (kept && !this.isFramed) {
      this.to.position.copy(kept.position);
      this.to.target.copy(kept.target);
      return;
    }
    const { width, height } = this.picture;
    const along = this.mode === "top" ? ABOVE_ALONG : this.isDeep ? DEEP_ALONG : ROOM_ALONG;
    const edges = { top: this.edges.top / height, bottom: this.edges.bottom / height };
    const view = framed(this.points, along, (this.to.fov * Math.PI) / 180, width / height, edges);
    this.to.position.set(...view.position);
    this.to.target.set(...view.target);
  }

  /**
   * Move on to `now`; returns whether the camera goes on moving.
   *
   * @param eyes of the chosen person, {W}
   * @param along where they point
   * @param pointer where the mouse aims, as -1 to 1 from left to right and from below to above; null: it does not
   */
  tick(
    now: number,
    seconds: number,
    eyes: Vec3 | null,
    along: Read3 | null,
    pointer: readonly [number, number] | null,
  ): boolean {
    const { camera, width, height } = this.picture;
    if (this.mode !== "eyes" && this.isFramed && width / height !== this.aspect) {
      this.aspect = width / height;
      this.go(now, true);
    }
    let moves = false;
    if (this.mode === "eyes") moves = this.look(seconds, eyes, along, pointer);
    if (!this.onWay)
      return this.mode === "eyes" ? this.sit() || moves : this.controls.update(seconds) || moves;
    const share = Math.min((now - this.began) / WAY_MS, 1);
    const eased = share * share * (3 - 2 * share);
    camera.position.lerpVectors(this.from.position, this.to.position, eased);
    this.controls.target.lerpVectors(this.from.target, this.to.target, eased);
    camera.fov = this.from.fov + (this.to.fov - this.from.fov) * eased;
    camera.updateProjectionMatrix();
    camera.lookAt(this.controls.target);
    if (share < 1) return true;
    this.onWay = false;
    if (this.mode !== "eyes") this.controls.update();
    return true;
  }

  private sit(): boolean {
    const { camera } = this.picture;
    camera.position.copy(this.to.position);
    this.controls.target.copy(this.to.target);
    camera.lookAt(this.controls.target);
    return false;
  }

  /** Turn the head: after the mouse while it aims, else after the person's own ray. */
  private look(
    seconds: number,
    eyes: Vec3 | null,
    along: Read3 | null,
    pointer: readonly [number, number] | null,
  ): boolean {
    let turn = 0;
    if (pointer) {
      const rate = (x: number) => (Math.sign(x) * Math.max(Math.abs(x) - STILL_SHARE, 0)) / (1 - STILL_SHARE);
      const left = -rate(pointer[0]) * TURN_RADPS * seconds;
      const up = rate(pointer[1]) * 0.6 * TURN_RADPS * seconds;
      this.yaw += left;
      this.pitch = Math.min(Math.max(this.pitch + up, -1.2), 0.9);
      turn = Math.abs(left) + Math.abs(up);
    } else if (along) {
      const gain = this.isStill ? 1 : 1 - Math.exp(-seconds * FOLLOW_PER_S);
      const left = wrapped(Math.atan2(along[1], along[0]) - this.yaw) * gain;
      const up =
        (Math.max(Math.asin(Math.max(-1, Math.min(1, along[2]))) * 0.8, LOWEST_RAD) - this.pitch) * gain;
      this.yaw += left;
      this.pitch += up;
      turn = Math.abs(left) + Math.abs(up);
    }
    if (eyes) this.to.position.set(...eyes);
    const level = Math.cos(this.pitch);
    this.to.target.copy(this.to.position);
    this.to.target.x += 2 * Math.cos(this.yaw) * level;
    this.to.target.y += 2 * Math.sin(this.yaw) * level;
    this.to.target.z += 2 * Math.sin(this.pitch);
    return turn > 1e-4;
  }

  dispose(): void {
    this.controls.dispose();
  }
}
