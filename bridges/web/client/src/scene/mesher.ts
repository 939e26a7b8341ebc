/** Builds surfaces from strips of quads, each with its own smooth normals. */

import * as THREE from "three";
import type { Cut } from "../geometry/ribbon";
import type { Read3, Vec3 } from "../geometry/vec";

export class Mesher {
  private readonly positions: number[] = [];
  private readonly uvs: number[] = [];
  private readonly index: number[] = [];

  /** A surface between two lines of as many points, seen from the side where `a` lies left when going along. */
  between(a: readonly Read3[], b: readonly Read3[], along?: readonly number[]): void {
    const first = this.positions.length / 3;
    a.forEach((left, i) => {
      this.positions.push(...left, ...b[i]!);
      const v = along?.[i] ?? 0;
      this.uvs.push(0, v, 1, v);
      if (i + 1 < a.length) {
        const at = first + 2 * i;
        this.index.push(at, at + 1, at + 2, at + 1, at + 3, at + 2);
      }
    });
  }

  /** Of a ribbon: its cuts `aside` m wider on either side and `up` m higher. */
  static edge(
    cuts: readonly Cut[],
    side: "left" | "right",
    aside: number,
    up: number,
    width: number,
  ): Vec3[] {
    return cuts.map((cut) => {
      const by = 1 + (2 * aside) / width;
      const edge = cut[side];
      const c = cut.center;
      return [c[0] + (edge[0] - c[0]) * by, c[1] + (edge[1] - c[1]) * by, c[2] + (edge[2] - c[2]) * by + up];
    });
  }

  /** A beam along a ribbon, closed all about: from `top` down to `bottom` (m above the line). */
  beam(cuts: readonly Cut[], width: number, aside: number, top: number, bottom: number): void {
    const edge = (side: "left" | "right", up: number) => Mesher.edge(cuts, side, aside, up, width);
    const lt = edge("left", top);
    const rt = edge("right", top);
    const lb = edge("left", bottom);
    const rb = edge("right", bottom);
    this.between(lt, rt);
    this.between(rt, rb);
    this.between(lb, lt);
    this.between(rb, lb);
    const end = cuts.length - 1;
    this.between([lb[0]!, lt[0]!], [rb[0]!, rt[0]!]);
    this.between([lt[end]!, lb[end]!], [rt[end]!, rb[end]!]);
  }

  geometry(): THREE.BufferGeometry {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(this.positions, 3));
    geometry.setAttribute("uv", new THREE.Float32BufferAttribute(this.uvs, 2));
    geometry.setIndex(this.index);
    geometry.computeVertexNormals();
    return geometry;
  }
}
