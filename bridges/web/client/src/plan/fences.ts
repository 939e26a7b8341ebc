/** Fences of the map: where robots must stay (outline), and where they may not go (hatched). Drawn once for each map. */

import type { Environment } from "../messages";
import { draw, path } from "./svg";

const HATCH = "plan-hatch";

export function drawFences(layer: Element, map: Environment): void {
  if (!map.fences.length) return;
  const hatch = draw(draw(layer, "defs"), "pattern", {
    id: HATCH,
    width: 24,
    height: 24,
    patternUnits: "userSpaceOnUse",
    patternTransform: "rotate(45)",
  });
  draw(hatch, "rect", { class: "plan-hatch", width: 8, height: 24 });
  for (const { id, kind, outline_m } of map.fences) {
    const d = path(outline_m, true);
    const isOut = kind === "keep_out";
    const fence = draw(layer, "path", {
      class: `plan-fence plan-${kind}`,
      d,
      ...(isOut ? { fill: `url(#${HATCH})` } : {}),
    });
    draw(fence, "title", {}, isOut ? `No robot may enter: ${id}` : `Robots stay within: ${id}`);
  }
}
