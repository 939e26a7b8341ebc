/** What stands still: the floor with a grid of metres, boxes, planes, cylinders, spheres, clouds. */

import * as THREE from "three";
import type { Environment } from "../messages";
import { ENDLESS_M, type Bounds } from "../geometry/bounds";
import { cross, unit, type Read3, type Vec3 } from "../geometry/vec";
import type { MeshFactory, Theme } from "./mesh_factory";

/** The grid goes on so far beyond the map, m. */
const FADE_M = 9;

/** The floor and the map's solids. */
export class Room {
  /** What can be pointed at. */
  readonly targets: THREE.Object3D[] = [];
  private ground: THREE.Object3D | null = null;
  private readonly solids: THREE.Mesh[] = [];

  constructor(factory: MeshFactory, map: Environment, bounds: Bounds) {
    this.floor(factory, bounds);
    const solid = factory.matt(factory.theme.solid, { roughness: 0.85 });
    for (const box of map.boxes) {
      const mesh = factory.mesh(new THREE.BoxGeometry(...box.size_m), solid);
      mesh.position.set(...box.center_m);
      mesh.rotation.z = box.yaw_rad;
      this.outlined(factory, mesh);
    }
    for (const tank of map.cylinders) {
      const mesh = factory.mesh(
        new THREE.CylinderGeometry(tank.radius_m, tank.radius_m, tank.height_m, factory.light ? 20 : 48),
        solid,
      );
      mesh.rotation.x = Math.PI / 2;
      mesh.position.set(tank.center_m[0], tank.center_m[1], tank.center_m[2] + tank.height_m / 2);
      this.outlined(factory, mesh);
    }
    for (const ball of map.spheres) {
      const mesh = factory.mesh(
        new THREE.SphereGeometry(ball.radius_m, factory.light ? 20 : 40, factory.light ? 12 : 28),
        solid,
      );
      mesh.position.set(...ball.center_m);
      this.solid(mesh);
    }
    for (const plane of map.planes) {
      const level = Math.abs(plane.normal[2]) > 0.999;
      if (!plane.size_m && level && Math.abs(plane.center_m[2]) < 0.05) continue;
      const [wide, tall] = plane.size_m ?? [ENDLESS_M, ENDLESS_M];
      const see = plane.size_m ? 0.5 : 0.14;
      const mesh = factory.mesh(
        new THREE.PlaneGeometry(wide, tall),
        factory.matt(factory.theme.solid, {
          transparent: true,
          opacity: see,
          side: THREE.DoubleSide,
          depthWrite: false,
        }),
        "shows",
      );
      mesh.position.set(...plane.center_m);
      mesh.quaternion.setFromRotationMatrix(axesOf(plane.normal));
      this.outlined(factory, mesh);
    }
    for (const cloud of map.clouds) {
      const size = cloud.high_m.map((high, axis) => Math.max(high - cloud.low_m[axis]!, 0.01)) as Vec3;
      const mesh = factory.mesh(
        new THREE.BoxGeometry(...size),
        factory.plain(factory.theme.solid, {
          transparent: true,
          opacity: 0.08,
          depthWrite: false,
        }),
        "",
      );
      mesh.position.set(...(cloud.low_m.map((low, axis) => low + size[axis]! / 2) as Vec3));
      this.outlined(factory, mesh);
    }
  }

  private outlined(factory: MeshFactory, mesh: THREE.Mesh): void {
    const lines = new THREE.LineSegments(
      factory.own(new THREE.EdgesGeometry(mesh.geometry, 30)),
      factory.own(new THREE.LineBasicMaterial({ color: factory.theme.leg, transparent: true, opacity: 0.7 })),
    );
    mesh.add(lines);
    this.solid(mesh);
  }

  private solid(mesh: THREE.Mesh): void {
    mesh.userData.isSolid = true;
    this.solids.push(mesh);
    this.targets.push(mesh);
  }

  /** In the viewer's own room there is a floor; solids are seen by their edges, and hide what is behind them. */
  setImmersed(isImmersed: boolean): void {
    if (this.ground) this.ground.visible = !isImmersed;
    for (const solid of this.solids) {
      (solid.material as THREE.Material).colorWrite = !isImmersed;
      solid.renderOrder = isImmersed ? -1 : 0;
    }
  }

  private floor(factory: MeshFactory, bounds: Bounds): void {
    const wide = Math.max(bounds.high[0] - bounds.low[0], bounds.high[1] - bounds.low[1]);
    const size = 2 * Math.ceil(factory.light ? wide / 2 + FADE_M + 2 : wide + 20);
    // whole metres lie on the grid's lines
    const x = Math.round((bounds.low[0] + bounds.high[0]) / 2);
    const y = Math.round((bounds.low[1] + bounds.high[1]) / 2);
    if (factory.light) {
      // the background is the floor: only its lines are drawn, filling the picture once more is what costs
      const plain = factory.mesh(new THREE.PlaneGeometry(4 * size, 4 * size), factory.plain(0), "");
      plain.visible = false;
      const grid = new THREE.LineSegments(
        factory.own(lines(size, bounds, factory.theme)),
        factory.own(new THREE.LineBasicMaterial({ vertexColors: true, fog: false })),
      );
      plain.position.set(x, y, 0);
      grid.position.set(x, y, 0);
      factory.group.add(grid);
      this.ground = grid;
      this.targets.push(plain);
      return;
    }
    const tile = factory.texture(
      256,
      256,
      (c) => {
        c.fillStyle = factory.theme.floor;
        c.fillRect(0, 0, 256, 256);
        c.strokeStyle = factory.theme.line;
        c.lineWidth = 5;
        c.strokeRect(0, 0, 256, 256);
        c.globalAlpha = 0.22;
        c.lineWidth = 2;
        c.strokeRect(128, -2, 200, 300);
        c.strokeRect(-2, 128, 300, 200);
      },
      true,
    );
    tile.repeat.set(size, size);
    const floor = factory.mesh(
      new THREE.PlaneGeometry(size, size),
      factory.matt(0xffffff, { map: tile, roughness: 0.92 }),
      "shows",
    );
    floor.position.set(x, y, 0);
    this.ground = floor;
    this.targets.push(floor);
  }
}

/** A grid of 1 m, `size` m wide about its middle, that fades into the background beyond `bounds`. */
function lines(size: number, bounds: Bounds, theme: Theme): THREE.BufferGeometry {
  const points: number[] = [];
  const colors: number[] = [];
  const half = size / 2;
  const line = new THREE.Color(theme.line);
  const far = new THREE.Color(theme.background);
  const color = new THREE.Color();
  const wide = (bounds.high[0] - bounds.low[0]) / 2;
  const tall = (bounds.high[1] - bounds.low[1]) / 2;
  const push = (x: number, y: number) => {
    const beyond = Math.hypot(Math.max(Math.abs(x) - wide, 0), Math.max(Math.abs(y) - tall, 0));
    points.push(x, y, 0);
    color.lerpColors(line, far, Math.min(Math.max(beyond - 1, 0) / FADE_M, 1)).toArray(colors, colors.length);
  };
  for (let at = -half; at <= half; at++) {
    for (let from = -half; from < half; from += 2) {
      push(at, from);
      push(at, from + 2);
      push(from, at);
      push(from + 2, at);
    }
  }
  const geometry = new THREE.BufferGeometry().setAttribute(
    "position",
    new THREE.Float32BufferAttribute(points, 3),
  );
  return geometry.setAttribute("color", new THREE.Float32BufferAttribute(colors, 3));
}

/** A plane's own axes u, v and its normal, as the map has them: v rises most, u is v x normal. */
function axesOf(normal: Read3): THREE.Matrix4 {
  const rise: Read3 = Math.abs(normal[2]) > 0.999999 ? [0, 1, 0] : [0, 0, 1];
  const u = unit(cross(rise, normal));
  const v = cross(normal, u);
  return new THREE.Matrix4().makeBasis(
    new THREE.Vector3(...u),
    new THREE.Vector3(...v),
    new THREE.Vector3(...normal),
  );
}
