/** The factory of meshes and materials of the scene in its mode and theme, which also disposes of them. */

import * as THREE from "three";

/** Colours that differ between the dark and the light page. */
export interface Theme {
  readonly dark: boolean;
  readonly background: number;
  readonly floor: string;
  readonly line: string;
  readonly frame: number;
  readonly leg: number;
  readonly rubber: string;
  readonly chevron: string;
  readonly solid: number;
  /** What pixels that are off look like, 0 to 1. */
  readonly off: number;
  readonly ink: string;
  readonly paper: string;
}

export const DARK: Theme = {
  dark: true,
  background: 0x11161d,
  floor: "#171d26",
  line: "#29323e",
  frame: 0xa9b6c4,
  leg: 0x4b5665,
  rubber: "#343b46",
  chevron: "#56616f",
  solid: 0x54606e,
  off: 0.52,
  ink: "#eef2f7",
  paper: "rgba(13,17,23,.78)",
};
export const LIGHT: Theme = {
  dark: false,
  background: 0xe4eaf1,
  floor: "#f3f5f8",
  line: "#cfd7e1",
  frame: 0xb9c3ce,
  leg: 0x78848f,
  rubber: "#4b535e",
  chevron: "#6b7480",
  solid: 0xb4bec9,
  off: 0.4,
  ink: "#141a22",
  paper: "rgba(255,255,255,.86)",
};

interface Disposable {
  dispose(): void;
}

/** Makes meshes in the current mode and theme; `dispose` frees them all. */
export class MeshFactory {
  readonly group = new THREE.Group();
  private readonly made = new Set<Disposable>();

  /** @param light without a graphics processor: cheap materials, no shadows */
  constructor(
    readonly light: boolean,
    readonly theme: Theme,
  ) {}

  own<T extends Disposable>(made: T): T {
    this.made.add(made);
    return made;
  }

  /** A lit material. */
  matt(color: THREE.ColorRepresentation, more: THREE.MeshStandardMaterialParameters = {}): THREE.Material {
    if (!this.light)
      return this.own(new THREE.MeshStandardMaterial({ roughness: 0.65, metalness: 0.05, color, ...more }));
    const { roughness: _r, metalness: _m, ...rest } = more;
    return this.own(new THREE.MeshLambertMaterial({ color, ...rest } as THREE.MeshLambertMaterialParameters));
  }

  /** An unlit material in the very colour. */
  plain(
    color: THREE.ColorRepresentation,
    more: THREE.MeshBasicMaterialParameters = {},
  ): THREE.MeshBasicMaterial {
    return this.own(new THREE.MeshBasicMaterial({ color, toneMapped: false, ...more }));
  }

  /** Put a mesh into the scene. */
  mesh(
    geometry: THREE.BufferGeometry,
    material: THREE.Material,
    shadows: "" | "casts" | "shows" | "both" = "both",
  ): THREE.Mesh {
    return this.put(new THREE.Mesh(this.own(geometry), material), shadows);
  }

  /** Put a mesh of `count` instances into the scene. */
  many(
    geometry: THREE.BufferGeometry,
    material: THREE.Material,
    count: number,
    shadows: "" | "casts" | "shows" | "both" = "both",
  ): THREE.InstancedMesh {
    const mesh = this.own(new THREE.InstancedMesh(this.own(geometry), material, Math.max(count, 1)));
    mesh.count = count;
    mesh.frustumCulled = false;
    return this.put(mesh, shadows);
  }

  private put<T extends THREE.Mesh>(mesh: T, shadows: string): T {
    mesh.castShadow = !this.light && (shadows === "casts" || shadows === "both");
    mesh.receiveShadow = !this.light && (shadows === "shows" || shadows === "both");
    this.group.add(mesh);
    return mesh;
  }

  /** The edges of a cube of 1 m. */
  edges(): THREE.LineSegments {
    const lines = new THREE.LineSegments(
      this.own(new THREE.EdgesGeometry(new THREE.BoxGeometry(1, 1, 1))),
      this.own(new THREE.LineBasicMaterial({ color: this.theme.ink })),
    );
    this.group.add(lines);
    return lines;
  }

  /** A texture drawn on a canvas; `repeat`: along both axes. */
  texture(
    width: number,
    height: number,
    draw: (context: CanvasRenderingContext2D) => void,
    repeat = false,
  ): THREE.CanvasTexture {
    const canvas = document.createElement("canvas");
    canvas.width = width;
    canvas.height = height;
    const context = canvas.getContext("2d");
    if (context) draw(context);
    const texture = this.own(new THREE.CanvasTexture(canvas));
    texture.colorSpace = THREE.SRGBColorSpace;
    texture.anisotropy = this.light ? 1 : 8;
    if (repeat) texture.wrapS = texture.wrapT = THREE.RepeatWrapping;
    return texture;
  }

  dispose(): void {
    this.group.removeFromParent();
    for (const each of this.made) each.dispose();
    this.made.clear();
  }
}

/** Write into `array`, at instance `i`, a matrix that scales, turns about z and moves. */
export function setMatrix(
  array: ArrayLike<number> & { [i: number]: number },
  i: number,
  x: number,
  y: number,
  z: number,
  yaw: number,
  sx: number,
  sy: number,
  sz: number,
): void {
  const c = Math.cos(yaw);
  const s = Math.sin(yaw);
  const at = 16 * i;
  array[at] = c * sx;
  array[at + 1] = s * sx;
  array[at + 2] = array[at + 3] = 0;
  array[at + 4] = -s * sy;
  array[at + 5] = c * sy;
  array[at + 6] = array[at + 7] = 0;
  array[at + 8] = array[at + 9] = 0;
  array[at + 10] = sz;
  array[at + 11] = 0;
  array[at + 12] = x;
  array[at + 13] = y;
  array[at + 14] = z;
  array[at + 15] = 1;
}
