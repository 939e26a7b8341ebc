/** Colours of boxes that depend on people, in the scene and in the plan alike. */

import { boxColor, type Rgb } from "../geometry/appearance";
import type { TrackedObject } from "../messages";
import { ownersOf, type Site } from "./site";

export const WHITE: Rgb = [255, 255, 255];

/** Colour of a box: of who owns it, or mixed with that of who is nearest to selecting it. */
export function currentBoxColor(site: Site, { id, kind }: Pick<TrackedObject, "id" | "kind">): Rgb {
  const owner = ownersOf(site).get(id);
  const pointing = [...site.people.values()].filter(({ hover }) => hover?.object_id === id);
  const [first] = pointing.sort((one, other) => other.hover!.progress - one.hover!.progress);
  const worn = (user: string) => site.people.get(user)?.profile?.cursor_color ?? WHITE;
  return boxColor(
    kind,
    owner ? worn(owner) : null,
    first ? { color: worn(first.user), progress: first.hover!.progress } : null,
  );
}
