/** What of the map does not move: floor, belts with their directions, solids, bays. Drawn once for each map. */

import type { Environment } from "../messages";
import { outline, ribbon } from "../geometry/ribbon";
import { confusion, type Separability } from "../geometry/separability";
import type { Bounds } from "../geometry/bounds";
import { cm, draw, path, turned, xy } from "./svg";
import type { Lanes } from "./lanes";

/** Margin of the floor around the objects on it, m. */
const ABOUT_M = 6;

/** Floor lines every metre, under all of `bounds`. */
export function drawFloor(layer: Element, bounds: Bounds): void {
  const [left, right] = [Math.floor(bounds.low[0]) - ABOUT_M, Math.ceil(bounds.high[0]) + ABOUT_M];
  const [low, high] = [Math.floor(bounds.low[1]) - ABOUT_M, Math.ceil(bounds.high[1]) + ABOUT_M];
  const lines: string[] = [];
  if (right - left > 200 || high - low > 200) return;
  for (let x = left; x <= right; x++) lines.push(`M${xy([x, low])}V${cm(-high)}`);
  for (let y = low; y <= high; y++) lines.push(`M${xy([left, y])}H${cm(right)}`);
  draw(layer, "path", { class: "plan-grid", d: lines.join("") });
}

/** Squares of the floor from where things are not told apart, and a line around all squares. */
export function drawSeparability(layer: Element, separability: Separability): void {
  const { x_m, y_m, told_apart } = separability;
  const box = (x: number, y: number, right: number, high: number) => ({
    x: cm(x),
    y: cm(-high),
    width: cm(right - x),
    height: cm(high - y),
  });
  told_apart.forEach((row, j) =>
    row.forEach((told, i) => {
      if (told === separability.things.length) return;
      draw(layer, "rect", {
        class: "plan-apart",
        "fill-opacity": confusion(separability, told).toFixed(2),
        ...box(x_m[i]!, y_m[j]!, x_m[i + 1]!, y_m[j + 1]!),
      });
    }),
  );
  draw(layer, "rect", { class: "plan-apart-edge", ...box(x_m[0]!, y_m[0]!, x_m.at(-1)!, y_m.at(-1)!) });
}

/** Belts as ribbons with arrows along them. */
export function drawBelts(layer: Element, map: Environment, lanes: Lanes): void {
  for (const belt of map.belts) {
    const line = lanes.line("belt", belt.id);
    if (!line) continue;
    draw(layer, "path", { class: "plan-belt", d: path(outline(ribbon(line, belt.width_m)), true) });
    const arrows: string[] = [];
    const count = Math.max(1, Math.floor(line.length / 0.9));
    for (let i = 0; i < count; i++) {
      const at = ((i + 0.5) * line.length) / count;
      const [x, y] = line.pointAt(at);
      const heading = line.headingAt(at);
      const size = 0.07;
      const wing = (side: number) => [
        x - size * Math.cos(heading + side),
        y - size * Math.sin(heading + side),
      ];
      arrows.push(path([wing(0.8), [x, y], wing(-0.8)]));
    }
    draw(layer, "path", { class: "plan-arrows", d: arrows.join("") });
  }
}

/** Boxes, planes, cylinders, spheres and clouds as their shadows on the floor. */
export function drawSolids(layer: Element, map: Environment): void {
  for (const plane of map.planes) {
    if (!plane.size_m) continue;
    const [u, v] = plane.size_m;
    const [nx, ny, nz] = plane.normal;
    const yaw = Math.hypot(nx, ny) > 1e-6 ? Math.atan2(ny, nx) - Math.PI / 2 : 0;
    const group = draw(layer, "g", { transform: `translate(${xy(plane.center_m)}) rotate(${turned(yaw)})` });
    const deep = Math.max(v * Math.abs(nz), 0.02);
    draw(group, "rect", {
      class: Math.abs(nz) > 0.5 ? "plan-level" : "plan-wall",
      x: cm(-u / 2),
      y: cm(-deep / 2),
      width: cm(u),
      height: cm(deep),
    });
  }
  for (const box of map.boxes) {
    const group = draw(layer, "g", {
      transform: `translate(${xy(box.center_m)}) rotate(${turned(box.yaw_rad)})`,
    });
    const [wide, deep] = box.size_m;
    draw(group, "rect", {
      class: "plan-solid",
      x: cm(-wide / 2),
      y: cm(-deep / 2),
      width: cm(wide),
      height: cm(deep),
    });
  }
  for (const round of [...map.cylinders, ...map.spheres]) {
    draw(layer, "circle", {
      class: "plan-solid",
      cx: cm(round.center_m[0]),
      cy: cm(-round.center_m[1]),
      r: cm(round.radius_m),
    });
  }
  for (const cloud of map.clouds) {
    const [wide, deep] = [cloud.high_m[0] - cloud.low_m[0], cloud.high_m[1] - cloud.low_m[1]];
    draw(layer, "rect", {
      class: "plan-cloud",
      x: cm(cloud.low_m[0]),
      y: cm(-cloud.high_m[1]),
      width: cm(wide),
      height: cm(deep),
    });
  }
}

/** A label of each bay, beyond the end of its belt; returns where its count is to be written, by bay. */
export function drawBays(layer: Element, map: Environment, lanes: Lanes): Map<string, SVGTextElement> {
  const counts = new Map<string, SVGTextElement>();
  for (const bay of map.bays) {
    const line = lanes.line("belt", bay.belt);
    if (!line) continue;
    const heading = line.headingAt(line.length);
    const [x, y] = line.pointAt(line.length + 0.12, true);
    const anchor = Math.cos(heading) > 0.4 ? "start" : Math.cos(heading) < -0.4 ? "end" : "middle";
    const lift = -Math.sin(heading) * 22;
    const group = draw(draw(layer, "g", { transform: `translate(${xy([x, y])})` }), "g", {
      class: "plan-upright",
    });
    draw(group, "text", { class: "plan-bay", "text-anchor": anchor, y: lift - 3 }, `Bay ${bay.id}`);
    counts.set(bay.id, draw(group, "text", { class: "plan-note", "text-anchor": anchor, y: lift + 13 }));
  }
  return counts;
}
