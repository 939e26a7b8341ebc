/** Shapes of items on the floor: where they are, moved, turned, stretched. {W}, metres, rad. Pure. */

import type { Item } from "./model";

export type Vec = readonly [number, number, number];

/** Rounded to a millimetre. */
export function mm(value: number): number {
  return Math.round(value * 1000) / 1000 + 0;
}

const rounded = (at: Vec): Vec => [mm(at[0]), mm(at[1]), mm(at[2])];
/** Half turns and more are written as less. */
const degrees = (yaw: number): number =>
  Math.round(((((yaw * 180) / Math.PI + 540) % 360) - 180) * 100) / 100 + 0;

/** Key of the place of an item that is not a strip. */
const placeKey = (item: Item): "position" | "center" => (item.section === "lamps" ? "position" : "center");

/** Vertices of a strip, or the middle; none for a thing that is where its light is. */
export function verticesOf({ section, value }: Item): readonly Vec[] {
  if (section === "strips") return value["line"] as readonly Vec[];
  const at = value[section === "lamps" ? "position" : "center"] as Vec | undefined;
  return at ? [at] : [];
}

/** The item with other vertices; a strip's `length`, where the file has one, follows. */
export function withVertices(item: Item, vertices: readonly Vec[]): Item {
  const all = vertices.map(rounded);
  if (item.section !== "strips") return { ...item, value: { ...item.value, [placeKey(item)]: all[0] } };
  const value: Record<string, unknown> = { ...item.value, line: all };
  if ("length" in value && Math.abs(lineLength(all) - lengthOf(item)) > 0.002)
    value["length"] = mm(lineLength(all));
  return { ...item, value };
}

export function moved(item: Item, dx: number, dy: number, dz = 0): Item {
  const vertices = verticesOf(item);
  return vertices.length
    ? withVertices(
        item,
        vertices.map(([x, y, z]) => [x + dx, y + dy, z + dz]),
      )
    : item;
}

/** Azimuth of a strip from its first to its last vertex, of a wall along it, of a box's x axis; null for lamps. */
export function yawOf({ section, value }: Item): number | null {
  if (section === "lamps") return null;
  if (section === "strips") {
    const line = value["line"] as readonly Vec[];
    const from = line[0]!;
    const to = line.at(-1)!;
    return Math.hypot(to[0] - from[0], to[1] - from[1]) < 1e-6
      ? null
      : Math.atan2(to[1] - from[1], to[0] - from[0]);
  }
  if (section === "planes") {
    const [x, y] = value["normal"] as Vec;
    return Math.hypot(x, y) < 1e-6 ? null : Math.atan2(x, -y);
  }
  return value["center"] ? (Number(value["yaw_deg"] ?? 0) * Math.PI) / 180 : null;
}

/** The item turned about its middle; as it is, if it has no direction. */
export function turned(item: Item, by: number): Item {
  const yaw = yawOf(item);
  if (yaw === null) return item;
  const [c, s] = [Math.cos(by), Math.sin(by)];
  if (item.section === "planes") {
    const [x, y, z] = item.value["normal"] as Vec;
    const fine = (value: number) => Math.round(value * 1e6) / 1e6 + 0;
    return { ...item, value: { ...item.value, normal: [fine(c * x - s * y), fine(s * x + c * y), z] } };
  }
  if (item.section !== "strips") return { ...item, value: { ...item.value, yaw_deg: degrees(yaw + by) } };
  const line = verticesOf(item);
  const [mx, my] = middleOf(item)!;
  return withVertices(
    item,
    line.map(([x, y, z]) => [mx + c * (x - mx) - s * (y - my), my + s * (x - mx) + c * (y - my), z]),
  );
}

/** All items about another origin: that of a strip is its first pixel, with x along it; heights stay. */
export function aboutOrigin(items: readonly Item[], origin: Item): readonly Item[] {
  const vertices = verticesOf(origin);
  const [x0, y0] = (origin.value["direction"] === -1 ? vertices.at(-1) : vertices[0])!;
  const yaw = (yawOf(origin) ?? 0) + (origin.value["direction"] === -1 ? Math.PI : 0);
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
  return items.map((item) => {
    const middle = middleOf(item);
    if (!middle) return item;
    const [x, y] = [middle[0] - x0, middle[1] - y0];
    return moved(turned(item, -yaw), c * x + s * y - middle[0], c * y - s * x - middle[1]);
  });
}

/** Middle between the ends of a strip, or the place of others. */
export function middleOf(item: Item): Vec | null {
  const vertices = verticesOf(item);
  const a = vertices[0];
  const b = vertices.at(-1);
  return a && b ? [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2] : null;
}

function lineLength(line: readonly Vec[]): number {
  return line
    .slice(1)
    .reduce(
      (sum, to, i) => sum + Math.hypot(to[0] - line[i]![0], to[1] - line[i]![1], to[2] - line[i]![2]),
      0,
    );
}

export function lengthOf(item: Item): number {
  return lineLength(verticesOf(item));
}

/** The strip with another length, in the same direction from its first vertex. */
export function withLength(item: Item, length: number): Item {
  const line = verticesOf(item);
  const first = line[0]!;
  const by = length / lengthOf(item);
  return withVertices(
    item,
    line.map(
      (at) => [0, 1, 2].map((axis) => first[axis]! + (at[axis]! - first[axis]!) * by) as unknown as Vec,
    ),
  );
}

/** Corners of a box, a thing or a wall, from above; null for strips and lamps. */
export function outlineOf(item: Item): readonly (readonly [number, number])[] | null {
  const middle = middleOf(item);
  const size = item.value["size"] as readonly number[] | undefined;
  if (!middle || !size || item.section === "strips") return null;
  const yaw = yawOf(item) ?? 0;
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
  const rises = item.section === "planes" ? Math.abs((item.value["normal"] as Vec)[2]) : 1;
  const [wide, deep] = [size[0]! / 2, Math.max((size[1]! * rises) / 2, 0.02)];
  return [
    [-wide, -deep],
    [wide, -deep],
    [wide, deep],
    [-wide, deep],
  ].map(([u, v]) => [middle[0] + c * u! - s * v!, middle[1] + s * u! + c * v!] as const);
}

/** Distance of a place from an item, from above, m. */
export function distanceTo(item: Item, x: number, y: number): number {
  const corners = outlineOf(item) ?? verticesOf(item);
  if (corners.length === 1) return Math.hypot(corners[0]![0] - x, corners[0]![1] - y);
  return Math.min(
    ...corners.slice(1).map((to, i) => {
      const from = corners[i]!;
      const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
      const share = Math.max(
        0,
        Math.min(1, ((x - from[0]) * dx + (y - from[1]) * dy) / (dx * dx + dy * dy || 1)),
      );
      return Math.hypot(from[0] + share * dx - x, from[1] + share * dy - y);
    }),
  );
}
