/** Everything that is rebuilt for every map and theme. */

import type { Bounds } from "../geometry/bounds";
import type { Read3, Vec3 } from "../geometry/vec";
import type { Environment } from "../messages";
import { Beams } from "./beams";
import { Belts } from "./belts";
import { drawFences } from "./fences";
import type { MeshFactory } from "./mesh_factory";
import type { Labels } from "./labels";
import { Lamps } from "./lamps";
import { Marks } from "./marks";
import { People } from "./people";
import { Robots } from "./robots";
import { Room } from "./room";
import { Strips } from "./strips";
import { Things } from "./things";

/** The parts of the scene; all are within `factory`. */
export interface World {
  readonly factory: MeshFactory;
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
  name: "",
  seq: 0,
  stamp_ns: 0,
  bays: [],
  belts: [],
  boxes: [],
  clouds: [],
  cylinders: [],
  fences: [],
  frames: [],
  lamps: [],
  links: [],
  paced_from: [],
  planes: [],
  spheres: [],
  strips: [],
  things: [],
};

/** Build the parts of `map`. `isStill`: without needless motion. */
export function makeWorld(
  factory: MeshFactory,
  map: Environment,
  bounds: Bounds,
  labels: Labels,
  isStill: boolean,
): World {
  const belts = new Belts(factory, map);
  const strips = new Strips(factory, map);
  const lamps = new Lamps(factory, map);
  const lines = (surface: string, id: string) => (surface === "belt" ? belts : strips).lines.get(id) ?? null;
  const things = new Things(factory, lines);
  const marks = new Marks(factory);
  const beams = new Beams(factory);
  const robots = new Robots({ factory, marks, beams, labels });
  drawFences(factory, map);
  const placeOf = (id: string): Read3 | null =>
    lamps.places.get(id) ?? robots.places.get(id) ?? things.byId.get(id)?.placed.at ?? null;
  const people = new People({ factory, marks, beams, labels, placeOf }, isStill);
  const bays = map.bays.flatMap(({ id, belt }) => {
    const line = belts.lines.get(belt);
    return line ? [{ id, at: line.pointAt(line.length) }] : [];
  });
  return {
    factory,
    belts,
    strips,
    lamps,
    room: new Room(factory, map, bounds),
    things,
    robots,
    people,
    marks,
    beams,
    bays,
  };
}
