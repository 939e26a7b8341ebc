/** LED strips: every pixel an instance, a glow about those that shine; their rails and posts. */

import * as THREE from "three";
import type { Environment, StripsFrame } from "../messages";
import { layOut, type Pixels } from "../geometry/pixels";
import { Polyline } from "../geometry/polyline";
import { ribbon } from "../geometry/ribbon";
import { setMatrix, type MeshFactory } from "./mesh_factory";
import { Mesher } from "./mesher";

const PIXEL_M = 0.02;
const GLOW_M = 0.085;
/** A strip that is no farther from a belt's edge is fixed to it and needs no posts. */
const FIXED_M = 0.15;
const POST_EVERY_M = 1.25;

const PIXEL_VERTEX = `
attribute vec3 place; attribute vec2 lie; attribute vec3 shine;
uniform float off; varying vec3 tint;
void main() {
  float lit = max(max(shine.r, shine.g), shine.b);
  tint = max(shine, vec3(off * (1.0 - min(lit * 3.0, 1.0))));
  #ifndef FLAT
  tint *= position.z > 0.3 ? 1.0 : 0.72;
#endif
  float c = cos(lie.x), s = sin(lie.x);
#ifdef FLAT
  vec3 along = mat3(viewMatrix) * vec3(c, s, 0.0);
  vec4 middle = viewMatrix * vec4(place, 1.0);
  vec3 aside = normalize(cross(along, middle.xyz));
  gl_Position = projectionMatrix * (middle + vec4(along * position.x * lie.y - aside * position.y * ${PIXEL_M.toFixed(4)}, 0.0));
  return;
#endif
  vec3 own = vec3(position.x * lie.y, position.yz * ${PIXEL_M.toFixed(4)});
  vec3 at = place + vec3(c * own.x - s * own.y, s * own.x + c * own.y, own.z);
  gl_Position = projectionMatrix * viewMatrix * vec4(at, 1.0);
}`;
const PIXEL_FRAGMENT = `varying vec3 tint; void main() { gl_FragColor = vec4(tint, 1.0); }`;
const GLOW_VERTEX = `
attribute vec3 place; attribute vec3 shine;
uniform float size; varying vec3 tint; varying vec2 q;
void main() {
  float lit = max(max(shine.r, shine.g), shine.b);
  tint = shine; q = position.xy;
  vec4 at = viewMatrix * vec4(place + vec3(0.0, 0.0, 0.015), 1.0);
  at.xy += position.xy * size * (0.6 + 0.6 * lit);
  at.z += 0.03;
  gl_Position = lit < 0.03 ? vec4(0.0, 0.0, 2.0, 1.0) : projectionMatrix * at;
}`;
const GLOW_FRAGMENT = `
uniform float over; varying vec3 tint; varying vec2 q;
void main() {
  float fall = max(1.0 - dot(q, q), 0.0);
  float a = fall * fall * mix(0.42, 0.5, over);
  gl_FragColor = vec4(tint * a, a * over * max(max(tint.r, tint.g), tint.b));
}`;

/** All strips of a map. */
export class Strips {
  readonly lines = new Map<string, Polyline>();
  /** What can be pointed at; unseen. */
  readonly targets: THREE.Object3D[] = [];
  private readonly pixels: Pixels;
  private readonly shine: THREE.BufferAttribute;
  /** Vertices that each pixel's colour is written to. */
  private readonly copies: number;
  private frame: StripsFrame | null = null;

  constructor(factory: MeshFactory, map: Environment) {
    this.pixels = layOut(map.strips);
    this.copies = factory.light ? 4 : 1;
    const { count } = this.pixels;
    const { copies } = this;
    const attribute = (array: Float32Array | Uint8Array, size: number, isByte = false) =>
      factory.light
        ? new THREE.BufferAttribute(array, size, isByte)
        : new THREE.InstancedBufferAttribute(array, size, isByte);
    this.shine = attribute(new Uint8Array(3 * copies * count), 3, true).setUsage(THREE.DynamicDrawUsage);
    if (!count) return;
    const lie = new Float32Array(2 * copies * count);
    const place = new Float32Array(3 * copies * count);
    for (const { first, pixels, pitch } of this.pixels.strips.values()) {
      for (let i = first * copies; i < (first + pixels) * copies; i++) {
        const pixel = Math.floor(i / copies);
        lie.set([this.pixels.headings[pixel]!, Math.min(pitch * 0.72, 0.05)], 2 * i);
        place.set(this.pixels.places.subarray(3 * pixel, 3 * pixel + 3), 3 * i);
      }
    }
    const body = factory.light ? faces(count, 0.5) : lenses(count);
    const glow = factory.light ? faces(count, 1) : halos(count);
    const where = attribute(place, 3);
    for (const geometry of [body, glow])
      geometry.setAttribute("place", where).setAttribute("shine", this.shine);
    body.setAttribute("lie", attribute(lie, 2));
    const lit = factory.mesh(
      body,
      factory.own(
        new THREE.ShaderMaterial({
          vertexShader: PIXEL_VERTEX,
          fragmentShader: PIXEL_FRAGMENT,
          uniforms: { off: { value: factory.theme.off } },
          ...(factory.light ? { defines: { FLAT: 1 }, side: THREE.DoubleSide } : {}),
        }),
      ),
      "",
    );
    const halo = factory.mesh(
      glow,
      factory.own(
        new THREE.ShaderMaterial({
          vertexShader: GLOW_VERTEX,
          fragmentShader: GLOW_FRAGMENT,
          transparent: true,
          depthWrite: false,
          blending: THREE.CustomBlending,
          blendSrc: THREE.OneFactor,
          blendDst: THREE.OneMinusSrcAlphaFactor,
          uniforms: { size: { value: GLOW_M }, over: { value: factory.theme.dark ? 0 : 1 } },
        }),
      ),
      "",
    );
    lit.frustumCulled = halo.frustumCulled = false;
    halo.renderOrder = 5;
    this.fix(factory, map);
  }

  /** Rails under the pixels, posts where no belt carries them, and what a mouse meets. */
  private fix(factory: MeshFactory, map: Environment): void {
    const belts = map.belts.map((belt) => ({ belt, line: new Polyline(belt.line_m) }));
    const rails = new Mesher();
    const reach = new Mesher();
    const posts: number[][] = [];
    for (const strip of map.strips) {
      if (!this.pixels.strips.has(strip.id)) continue;
      const line = new Polyline(strip.line_m);
      const cuts = ribbon(line, 0.03);
      this.lines.set(strip.id, line);
      const middle = line.pointAt(line.length / 2);
      const fixed = belts.some(
        ({ belt, line: other }) => other.nearestTo(middle).apart < belt.width_m / 2 + FIXED_M,
      );
      rails.beam(cuts, 0.03, fixed ? -0.002 : 0.004, -0.001, fixed ? -0.012 : -0.035);
      reach.beam(cuts, 0.03, 0.02, 0.02, -0.04);
      if (fixed) continue;
      const count = Math.max(2, Math.ceil(line.length / POST_EVERY_M) + 1);
      for (let i = 0; i < count; i++) {
        const at = 0.05 + ((line.length - 0.1) * i) / (count - 1);
        const [x, y, z] = line.pointAt(at);
        if (z > 0.1) posts.push([x, y, (z - 0.03) / 2, line.headingAt(at), 0.03, 0.03, z - 0.03]);
      }
    }
    factory.mesh(rails.geometry(), factory.matt(factory.theme.leg, { roughness: 0.5, metalness: 0.3 }));
    const proxy = factory.mesh(reach.geometry(), factory.plain(0), "");
    proxy.visible = false;
    this.targets.push(proxy);
    if (!posts.length) return;
    const stands = factory.many(
      new THREE.BoxGeometry(1, 1, 1),
      factory.matt(factory.theme.leg),
      posts.length,
    );
    posts.forEach(([x, y, z, yaw, sx, sy, sz], i) =>
      setMatrix(stands.instanceMatrix.array, i, x!, y!, z!, yaw!, sx!, sy!, sz!),
    );
  }

  /** Show `frame`; returns whether it is another than before. */
  set(frame: StripsFrame | null): boolean {
    if (frame === this.frame) return false;
    this.frame = frame;
    const shown = this.shine.array as Uint8Array;
    const { copies } = this;
    if (!frame) shown.fill(0);
    else {
      for (const { id, rgb } of frame.strips) {
        const strip = this.pixels.strips.get(id);
        if (!strip) continue;
        const end = Math.min(rgb.length, 3 * strip.pixels);
        let to = 3 * copies * strip.first;
        for (let from = 0; from + 2 < end; from += 3) {
          for (let copy = 0; copy < copies; copy++) {
            shown[to++] = rgb[from]!;
            shown[to++] = rgb[from + 1]!;
            shown[to++] = rgb[from + 2]!;
          }
        }
      }
    }
    this.shine.needsUpdate = true;
    return true;
  }
}

const SQUARE = [-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0];

/** A lens of ten triangles for each of `count` pixels: instances. */
function lenses(count: number): THREE.BufferGeometry {
  const geometry = new THREE.InstancedBufferGeometry();
  const n = 0.34;
  const z = 0.55;
  geometry.instanceCount = count;
  geometry.setAttribute(
    "position",
    new THREE.Float32BufferAttribute(
      [-0.5, -0.5, 0, 0.5, -0.5, 0, 0.5, 0.5, 0, -0.5, 0.5, 0, -n, -n, z, n, -n, z, n, n, z, -n, n, z],
      3,
    ),
  );
  geometry.setIndex([
    4, 5, 6, 4, 6, 7, 0, 1, 5, 0, 5, 4, 1, 2, 6, 1, 6, 5, 2, 3, 7, 2, 7, 6, 3, 0, 4, 3, 4, 7,
  ]);
  return geometry;
}

/** A square for each of `count` pixels: instances. */
function halos(count: number): THREE.BufferGeometry {
  const geometry = new THREE.InstancedBufferGeometry();
  geometry.instanceCount = count;
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(SQUARE, 3));
  geometry.setIndex([0, 1, 2, 0, 2, 3]);
  return geometry;
}

/** A square (half a side: `half`) for each of `count` pixels, written out: software draws instances one by one. */
function faces(count: number, half: number): THREE.BufferGeometry {
  const corners = new Float32Array(12 * count);
  const index = new Uint32Array(6 * count);
  const geometry = new THREE.BufferGeometry();
  const corner = SQUARE.map((x) => x * half);
  for (let i = 0; i < count; i++) {
    corners.set(corner, 12 * i);
    index.set([4 * i, 4 * i + 1, 4 * i + 2, 4 * i, 4 * i + 2, 4 * i + 3], 6 * i);
  }
  geometry.setAttribute("position", new THREE.BufferAttribute(corners, 3));
  return geometry.setIndex(new THREE.BufferAttribute(index, 1));
}
