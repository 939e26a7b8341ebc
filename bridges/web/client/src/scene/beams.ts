/** Straight lines of light of an even width on the screen: rays, and the gap to the mouse. */

import * as THREE from "three";
import type { Read3 } from "../geometry/vec";
import type { MeshFactory } from "./mesh_factory";

const VERTEX = `
attribute vec3 start; attribute vec3 finish; attribute vec4 tint; attribute vec3 look;
uniform vec2 screen; varying vec4 color; varying float along; varying float dash; varying float across;
void main() {
  vec4 a = viewMatrix * vec4(start, 1.0), b = viewMatrix * vec4(finish, 1.0);
  float near = -0.12;
  if (a.z > near && b.z < near) a = mix(a, b, (near - a.z) / (b.z - a.z));
  if (b.z > near && a.z < near) b = mix(b, a, (near - b.z) / (a.z - b.z));
  vec4 ca = projectionMatrix * a, cb = projectionMatrix * b;
  vec2 way = (cb.xy / cb.w - ca.xy / ca.w) * screen;
  vec2 side = normalize(vec2(-way.y, way.x) + vec2(1e-6, 0.0)) / screen;
  vec4 at = position.x < 0.5 ? ca : cb;
  at.xy += side * position.y * look.x * at.w;
  if (a.z > near && b.z > near) at = vec4(0.0, 0.0, 2.0, 1.0);
  across = position.y; dash = look.y;
  along = position.x * distance(start, finish);
  color = vec4(tint.rgb, tint.a * (position.x < 0.5 ? 1.0 : look.z));
  gl_Position = at;
}`;
const FRAGMENT = `
varying vec4 color; varying float along; varying float dash; varying float across;
void main() {
  if (dash > 0.0 && fract(along / dash) > 0.5) discard;
  float a = color.a * (1.0 - smoothstep(0.45, 1.0, abs(across)));
  gl_FragColor = vec4(color.rgb * a, a);
}`;
const AT_MOST = 128;

/** Beams of one frame: `begin`, `add` …, `end`. */
export class Beams {
  private readonly geometry = new THREE.InstancedBufferGeometry();
  private readonly arrays: THREE.InstancedBufferAttribute[];
  private readonly screen = { value: new THREE.Vector2(1, 1) };
  private count = 0;

  constructor(factory: MeshFactory) {
    this.geometry.setAttribute(
      "position",
      new THREE.Float32BufferAttribute([0, -1, 0, 1, -1, 0, 1, 1, 0, 0, 1, 0], 3),
    );
    this.geometry.setIndex([0, 1, 2, 0, 2, 3]);
    this.arrays = (
      [
        ["start", 3],
        ["finish", 3],
        ["tint", 4],
        ["look", 3],
      ] as const
    ).map(([name, size]) => {
      const made = new THREE.InstancedBufferAttribute(new Float32Array(AT_MOST * size), size);
      made.setUsage(THREE.DynamicDrawUsage);
      this.geometry.setAttribute(name, made);
      return made;
    });
    const mesh = factory.mesh(
      this.geometry,
      factory.own(
        new THREE.ShaderMaterial({
          vertexShader: VERTEX,
          fragmentShader: FRAGMENT,
          transparent: true,
          depthWrite: false,
          side: THREE.DoubleSide,
          blending: THREE.CustomBlending,
          blendSrc: THREE.OneFactor,
          blendDst: THREE.OneMinusSrcAlphaFactor,
          uniforms: { screen: this.screen },
        }),
      ),
      "",
    );
    mesh.frustumCulled = false;
    mesh.renderOrder = 7;
  }

  /** @param width, height of the picture in pixels of the page */
  begin(width: number, height: number): void {
    this.count = 0;
    this.screen.value.set(width / 2, height / 2);
  }

  /** `wide`: px to either side; `dash`: m of a dash and its gap, 0: none; `end`: opacity at its end, as a share. */
  add(from: Read3, to: Read3, color: Read3, alpha: number, wide: number, dash = 0, end = 1): void {
    if (this.count >= AT_MOST) return;
    const [start, finish, tint, look] = this.arrays;
    const i = this.count++;
    start!.setXYZ(i, from[0], from[1], from[2]);
    finish!.setXYZ(i, to[0], to[1], to[2]);
    tint!.setXYZW(i, color[0] / 255, color[1] / 255, color[2] / 255, alpha);
    look!.setXYZ(i, wide, dash, end);
  }

  end(): void {
    this.geometry.instanceCount = this.count;
    for (const each of this.arrays) each.needsUpdate = true;
  }
}
