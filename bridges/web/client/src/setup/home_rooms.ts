/** Lamps of a home by room, as its view shows them. Pure. */

import type { HomeLamp } from "../messages";
import { byArea } from "./setup_words";

/** A thing of the map, as its tile in the panel has it. */
export interface HomeThing {
  id: string;
  name: string;
  isOn: boolean;
  state: string;
  canBeTried: boolean;
}

/** One line of the view: a lamp of the home, and the thing of the map that it is. */
export interface HomeTile extends HomeThing {
  kind: HomeLamp["kind"];
  quality: HomeLamp["quality"];
}

/** Things by room, those without one last. Things of the map that are no lamp of the home have no room. */
export function roomsOf(
  things: readonly HomeThing[],
  lamps: readonly HomeLamp[],
): [room: string, tiles: HomeTile[]][] {
  const rooms: [string, HomeTile[]][] = [];
  for (const [area, own] of byArea(lamps)) {
    const tiles: HomeTile[] = [];
    for (const lamp of own) {
      const thing = things.find(({ name }) => name === nameOf(lamp));
      if (lamp.is_chosen && thing) tiles.push({ ...thing, kind: lamp.kind, quality: lamp.quality });
    }
    if (tiles.length) rooms.push([area, tiles]);
  }
  const known = new Set(rooms.flatMap(([, tiles]) => tiles.map(({ id }) => id)));
  const others = things.filter(({ id }) => !known.has(id));
  if (others.length)
    rooms.push(["", others.map((thing) => ({ ...thing, kind: "other" as const, quality: "" as const }))]);
  return rooms;
}

function nameOf({ label, id }: HomeLamp): string {
  return label || id;
}
