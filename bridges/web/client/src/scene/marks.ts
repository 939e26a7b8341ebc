/** Rings, discs, gauges and glows, flat or facing the camera: all in one draw. And beams between two places. */

import * as THREE from "three";
import type { Pattern } from "../geometry/appearance";
import type { Read3 } from "../geometry/vec";
import type { MeshFactory } from "./mesh_factory";

const STYLES: Readonly<Record<Pattern | "glow", number>> = {
  solid: 0,
  dashed: 1,
  dotted: 2,
  striped: 3,
  hollow: 4,
  tailed: 5,
  glow: 6,
};

const VERTEX = `
attribute vec3 place; attribute vec4 shape; attribute vec4 tint; attribute vec4 style;
uniform float pixel; varying vec2 q; varying vec4 color; varying vec3 look; varying float edge; varying float fill;
void main() {
  q = position.xy; color = tint; look = vec3(style.xy, shape.w); fill = style.w;
  if (style.z > 0.5) {
    vec4 at = viewMatrix * vec4(place, 1.0);
    float size = max(shape.x, 9.0 * pixel * -at.z);
    at.xyz -= normalize(at.xyz) * min(max(size, 0.34), -at.z * 0.3);
    at.xy += q * size;
    edge = 1.2 * pixel * -at.z / size;
    gl_Position = projectionMatrix * at;
  } else {
    vec2 o = q * shape.xy; float c = cos(shape.z), s = sin(shape.z);
    vec4 at = viewMatrix * vec4(place + vec3(c * o.x - s * o.y, s * o.x + c * o.y, 0.0), 1.0);
    edge = 1.5 * pixel * max(-at.z, 0.0) / max(min(shape.x, shape.y), 0.001);
    gl_Position = projectionMatrix * at;
  }
}`;
const FRAGMENT = `
uniform float over; varying vec2 q; varying vec4 color; varying vec3 look; varying float edge; varying float fill;
float comb(float turn, float count, float share) { return step(fract(turn * count), share); }
void main() {
  float r = length(q), soft = clamp(edge, 0.005, 0.3);
  if (r > 1.0) discard;
  if (look.x > 5.5) {
    float a = pow(1.0 - r, 2.0) * color.a + (1.0 - smoothstep(0.1, 0.2, r)) * color.a;
    gl_FragColor = vec4(mix(color.rgb, vec3(1.0), (1.0 - smoothstep(0.0, 0.22, r)) * 0.75) * min(a, 1.0), min(a, 1.0) * over);
    return;
  }
  float turn = fract(atan(q.x, q.y) / 6.2831853 + 1.0);
  float inner = 1.0 - look.z;
  float ring = smoothstep(inner - soft, inner + soft, r) * (1.0 - smoothstep(1.0 - 2.0 * soft, 1.0, r));
  float on = 1.0;
  if (look.x > 4.5) on = 1.0 - turn;
  else if (look.x > 3.5) { float m = abs((r - inner) / look.z - 0.5) * 2.0; on = step(0.5, m); }
  else if (look.x > 2.5) on = max(comb(turn, 6.0, 0.5), step(0.67, fract(turn * 6.0)) * step(fract(turn * 6.0), 0.83));
  else if (look.x > 1.5) on = comb(turn, 20.0, 0.5);
  else if (look.x > 0.5) on = comb(turn, 8.0, 0.65);
  float past = step(turn, look.y);
  float a = ring * mix(0.3, 1.0, on * past) * color.a + fill * (1.0 - step(inner, r)) * color.a;
  if (look.x > 0.5 && on < 0.5) a = fill * color.a * step(r, inner);
  if (a < 0.01) discard;
  gl_FragColor = vec4(color.rgb * a, a);
}`;

/** How a mark looks. */
export interface MarkLook {
  pattern?: Pattern | "glow";
  /** How far round it is drawn fully, 0 to 1. */
  progress?: number;
  /** It faces the camera. */
  faces?: boolean;
  /** Opacity inside, as a share of the ring's. */
  fill?: number;
  /** Of the ring, as a share of the radius. */
  thick?: number;
  alpha?: number;
}

const AT_MOST = 384;

/** Marks of one frame: `begin`, `add` …, `end`. */
export class Marks {
  private readonly geometry = new THREE.InstancedBufferGeometry();
  private readonly arrays: Record<"place" | "shape" | "tint" | "style", THREE.InstancedBufferAttribute>;
  private readonly pixel = { value: 0.001 };
  private count = 0;

  constructor(factory: MeshFactory) {
    this.geometry.setAttribute(
      "position",
      new THREE.Float32BufferAttribute([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0], 3),
    );
    this.geometry.setIndex([0, 1, 2, 0, 2, 3]);
    const array = (name: string, size: number) => {
      const made = new THREE.InstancedBufferAttribute(new Float32Array(AT_MOST * size), size).setUsage(
        THREE.DynamicDrawUsage,
      );
      this.geometry.setAttribute(name, made);
      return made as THREE.InstancedBufferAttribute;
    };
    this.arrays = {
      place: array("place", 3),
      shape: array("shape", 4),
      tint: array("tint", 4),
      style: array("style", 4),
    };
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
          uniforms: { pixel: this.pixel, over: { value: factory.theme.dark ? 0 : 1 } },
        }),
      ),
      "",
    );
    mesh.frustumCulled = false;
    mesh.renderOrder = 8;
  }

  /** @param pixel size of a pixel of the picture 1 m away, m */
  begin(pixel: number): void {
    this.count = 0;
    this.pixel.value = pixel;
  }

  /** A mark of `radius` m (`other`: along its other axis, turned by `angle`) at `at`; colours 0-255. */
  add(at: Read3, radius: number, color: Read3, look: MarkLook, up = 0, other = radius, angle = 0): void {
    if (this.count >= AT_MOST) return;
    const { place, shape, tint, style } = this.arrays;
    const i = this.count++;
    place.setXYZ(i, at[0], at[1], at[2] + up);
    shape.setXYZW(i, radius, other, angle, look.thick ?? 0.16);
    tint.setXYZW(i, color[0] / 255, color[1] / 255, color[2] / 255, look.alpha ?? 1);
    style.setXYZW(i, STYLES[look.pattern ?? "solid"], look.progress ?? 1, look.faces ? 1 : 0, look.fill ?? 0);
  }

  end(): void {
    this.geometry.instanceCount = this.count;
    for (const each of Object.values(this.arrays)) each.needsUpdate = true;
  }
}
