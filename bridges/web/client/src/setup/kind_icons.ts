/** Icons of what a home has. */

import type { HomeLamp } from "../messages";

export const KIND_ICONS: Readonly<Record<HomeLamp["kind"], string>> = {
  lamp: "bulb",
  ceiling: "ceiling",
  strip: "strip",
  spot: "spot",
  plug: "power",
  fan: "fan",
  cover: "cover",
  media: "play",
  scene: "sun",
  danger: "warning",
  other: "cube",
};
