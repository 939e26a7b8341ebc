/** How a person's things look in the plan: their colour, and the dashes that stand for their pattern. */

import type { UserProfile } from "../messages";
import { cssColor } from "../geometry/appearance";

/** Dashes of each pattern, px; lines are drawn with `vector-effect: non-scaling-stroke`. */
const DASHES: Readonly<Record<UserProfile["pattern"], string>> = {
  solid: "none",
  dashed: "9 5",
  dotted: "2 4",
  striped: "9 3 2 3",
  hollow: "none",
  tailed: "16 3 3 3",
};

export interface PersonStyle {
  color: string;
  dashes: string;
  /** Drawn as an outline with nothing within. */
  isHollow: boolean;
  /** In words, for who does not see. */
  pattern: UserProfile["pattern"];
}

/** The style of a person; white and solid without a profile. */
export function styleOf(profile: UserProfile | null | undefined): PersonStyle {
  const pattern = profile?.pattern ?? "solid";
  return {
    color: cssColor(profile?.cursor_color ?? [255, 255, 255]),
    dashes: DASHES[pattern],
    isHollow: pattern === "hollow",
    pattern,
  };
}
