/** Everything that is rebuilt for every map and theme. */

import type { Bounds } from "../geometry/bounds";
import type { Read3, Vec3 } from "../geometry/vec";
import type { Environment } from "../messages";
import { Beams } from "./beams";
import { Belts } from "./belts";
import { drawFences } from "./fences";
import type { Kit } from "./kit";
import type { Labels } from "./labels";
import { Lamps } from "./lamps";
import { Marks } from "./marks";
import { People } from "./people";
import { Robots } from "./robots";
import { Room } from "./room";
import { Strips } from "./strips";
import { Things } from "./things";

/** The parts of the scene; all are within `kit`. */
export interface World {
  readonly kit: Kit;
  readonly belts: Belts;
  readonly strips: Strips;
  readonly lamps: Lamps;
  readonly room: Room;
  readonly things: Things;
  readonly robots: Robots;
  readonly people: People;
  readonly marks: Marks;
  readonly beams: Beams;
  readonly bays: readonly { id: string; at: Vec3 }[];
}

/** A map with nothing in it. */
export const NOTHING: Environment = {
  name: "", seq: 0, stamp_ns: 0, bays: [], belts: [], boxes: [], clouds: [], cylinders: [], fences: [], frames: [], lamps: [], links: [],
  planes: [], spheres: [], strips: [], things: [],
};

/** Build the parts of `map`. `isStill`: without needless motion. */
export function makeWorld(kit: Kit, map: Environment, bounds: Bounds, labels: Labels, isStill: boolean): World {
  const belts = new Belts(kit, map), strips = new Strips(kit, map), lamps = new Lamps(kit, map);
  const lines = (surface: string, id: string) => (surface === "belt" ? belts : strips).lines.get(id) ?? null;
  const things = new Things(kit, lines), marks = new Marks(kit), beams = new Beams(kit);
  const robots = new Robots({ kit, marks, beams, labels });
  drawFences(kit, map);
  const placeOf = (id: string): Read3 | null => lamps.places.get(id) ?? robots.places.get(id) ?? things.byId.get(id)?.placed.at ?? null;
  const people = new People({ kit, marks, beams, labels, placeOf }, isStill);
  const bays = map.bays.flatMap(({ id, belt }) => {
    const line = belts.lines.get(belt);
    return line ? [{ id, at: line.pointAt(line.length) }] : [];
  });
  return { kit, belts, strips, lamps, room: new Room(kit, map, bounds), things, robots, people, marks, beams, bays };
}
