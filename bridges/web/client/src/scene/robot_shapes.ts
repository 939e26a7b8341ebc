/** Shapes of robots, 1 m across, their front (x) in another colour. */

import * as THREE from "three";
import { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";

const FRONT = 0xffb000;
const DARK = 0x2f3742;
const GREY = 0x56606d;
const LIGHT = 0xe7ecf2;

type Paint = (geometry: THREE.BufferGeometry, color: number) => void;

/** Merge what `make` paints; colours are those of the vertices. */
function painted(make: (paint: Paint) => void): THREE.BufferGeometry {
  const parts: THREE.BufferGeometry[] = [];
  make((geometry, color) => {
    const { count } = geometry.getAttribute("position");
    const paint = new THREE.Color(color);
    geometry.setAttribute(
      "color",
      new THREE.Float32BufferAttribute(Array.from({ length: count }, () => paint.toArray()).flat(), 3),
    );
    parts.push(geometry);
  });
  return mergeGeometries(parts);
}

/** A small flying robot with four rotors; its middle is the origin. */
export function quadrotor(): THREE.BufferGeometry {
  return painted((part) => {
    for (const turn of [Math.PI / 4, -Math.PI / 4])
      part(new THREE.BoxGeometry(0.78, 0.05, 0.04).rotateZ(turn), DARK);
    part(new THREE.BoxGeometry(0.3, 0.2, 0.12), LIGHT);
    part(new THREE.SphereGeometry(0.06, 12, 8).translate(0.15, 0, 0), FRONT);
    for (const x of [-0.27, 0.27]) {
      for (const y of [-0.27, 0.27]) {
        part(new THREE.TorusGeometry(0.19, 0.016, 6, 20).translate(x, y, 0.06), x > 0 ? FRONT : GREY);
        part(
          new THREE.CylinderGeometry(0.035, 0.035, 0.1, 8).rotateX(Math.PI / 2).translate(x, y, 0.03),
          DARK,
        );
      }
    }
  });
}

/** A robot on two driven wheels; the floor below its middle is the origin. */
export function groundRobot(): THREE.BufferGeometry {
  return painted((part) => {
    part(new THREE.CylinderGeometry(0.46, 0.5, 0.26, 24).rotateX(Math.PI / 2).translate(0, 0, 0.2), LIGHT);
    part(new THREE.CylinderGeometry(0.34, 0.4, 0.1, 24).rotateX(Math.PI / 2).translate(0, 0, 0.38), GREY);
    part(new THREE.ConeGeometry(0.1, 0.22, 3).rotateZ(-Math.PI / 2).translate(0.28, 0, 0.44), FRONT);
    for (const y of [-0.42, 0.42])
      part(new THREE.CylinderGeometry(0.16, 0.16, 0.1, 16).translate(0, y, 0.16), DARK);
  });
}
