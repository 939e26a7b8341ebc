/** What stands still: the floor with a grid of metres, boxes, planes, cylinders, spheres, clouds. */

import * as THREE from "three";
import type { Environment } from "../messages";
import { ENDLESS_M, type Bounds } from "../geometry/bounds";
import { cross, unit, type Read3, type Vec3 } from "../geometry/vec";
import type { Kit } from "./kit";

/** The floor and the map's solids. */
export class Room {
  /** What can be pointed at. */
  readonly targets: THREE.Object3D[] = [];

  constructor(kit: Kit, map: Environment, bounds: Bounds) {
    this.floor(kit, bounds);
    const solid = kit.matt(kit.theme.solid, { roughness: 0.85 });
    for (const box of map.boxes) {
      const mesh = kit.mesh(new THREE.BoxGeometry(...box.size_m), solid);
      mesh.position.set(...box.center_m);
      mesh.rotation.z = box.yaw_rad;
      this.outlined(kit, mesh);
    }
    for (const tank of map.cylinders) {
      const mesh = kit.mesh(new THREE.CylinderGeometry(tank.radius_m, tank.radius_m, tank.height_m, kit.light ? 20 : 48), solid);
      mesh.rotation.x = Math.PI / 2;
      mesh.position.set(tank.center_m[0], tank.center_m[1], tank.center_m[2] + tank.height_m / 2);
      this.outlined(kit, mesh);
    }
    for (const ball of map.spheres) {
      const mesh = kit.mesh(new THREE.SphereGeometry(ball.radius_m, kit.light ? 20 : 40, kit.light ? 12 : 28), solid);
      mesh.position.set(...ball.center_m);
      this.targets.push(mesh);
    }
    for (const plane of map.planes) {
      const level = Math.abs(plane.normal[2]) > 0.999;
      if (!plane.size_m && level && Math.abs(plane.center_m[2]) < 0.05) continue;
      const [wide, tall] = plane.size_m ?? [ENDLESS_M, ENDLESS_M];
      const see = plane.size_m ? 0.5 : 0.14;
      const mesh = kit.mesh(new THREE.PlaneGeometry(wide, tall), kit.matt(kit.theme.solid, {
        transparent: true, opacity: see, side: THREE.DoubleSide, depthWrite: false,
      }), "shows");
      mesh.position.set(...plane.center_m);
      mesh.quaternion.setFromRotationMatrix(axesOf(plane.normal));
      this.outlined(kit, mesh);
    }
    for (const cloud of map.clouds) {
      const size = cloud.high_m.map((high, axis) => Math.max(high - cloud.low_m[axis]!, 0.01)) as Vec3;
      const mesh = kit.mesh(new THREE.BoxGeometry(...size), kit.plain(kit.theme.solid, {
        transparent: true, opacity: 0.08, depthWrite: false,
      }), "");
      mesh.position.set(...(cloud.low_m.map((low, axis) => low + size[axis]! / 2) as Vec3));
      this.outlined(kit, mesh);
    }
  }

  private outlined(kit: Kit, mesh: THREE.Mesh): void {
    const lines = new THREE.LineSegments(
      kit.own(new THREE.EdgesGeometry(mesh.geometry, 30)),
      kit.own(new THREE.LineBasicMaterial({ color: kit.theme.leg, transparent: true, opacity: 0.7 })),
    );
    mesh.add(lines);
    this.targets.push(mesh);
  }

  private floor(kit: Kit, bounds: Bounds): void {
    const reach = Math.max(bounds.high[0] - bounds.low[0], bounds.high[1] - bounds.low[1]) * 2 + 40;
    const size = 2 * Math.ceil(reach / 2);
    const tile = kit.texture(256, 256, (c) => {
      c.fillStyle = kit.theme.floor;
      c.fillRect(0, 0, 256, 256);
      c.strokeStyle = kit.theme.line;
      c.lineWidth = 5;
      c.strokeRect(0, 0, 256, 256);
      c.globalAlpha = 0.22;
      c.lineWidth = 2;
      c.strokeRect(128, -2, 200, 300);
      c.strokeRect(-2, 128, 300, 200);
    }, true);
    tile.repeat.set(size, size);
    const material = kit.light ? kit.plain(0xffffff, { map: tile }) : kit.matt(0xffffff, { map: tile, roughness: 0.92 });
    const floor = kit.mesh(new THREE.PlaneGeometry(size, size), material, "shows");
    // whole metres lie on the grid's lines
    floor.position.set(Math.round((bounds.low[0] + bounds.high[0]) / 2), Math.round((bounds.low[1] + bounds.high[1]) / 2), 0);
    this.targets.push(floor);
  }
}

/** A plane's own axes u, v and its normal, as the map has them: v rises most, u is v x normal. */
function axesOf(normal: Read3): THREE.Matrix4 {
  const rise: Read3 = Math.abs(normal[2]) > 0.999999 ? [0, 1, 0] : [0, 0, 1];
  const u = unit(cross(rise, normal)), v = cross(normal, u);
  return new THREE.Matrix4().makeBasis(new THREE.Vector3(...u), new THREE.Vector3(...v), new THREE.Vector3(...normal));
}
