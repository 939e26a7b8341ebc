/** Places from which a map without measured lengths was paced: what it is good for. Drawn once for each map. */

import type { Environment } from "../messages";
import { draw, path, xy } from "./svg";

export function drawPlaces(layer: Element, map: Environment): void {
  const places = map.paced_from ?? []; // of a map of before: none
  if (!places.length || !map.things.length) return;
  const between = places.length > 1 ? ", and from between them" : "";
  const text = `Lengths are paced: directions are known from ${places.map(({ id }) => id).join(" and ")}${between}`;
  const group = draw(layer, "g", { class: "plan-places" });
  draw(group, "title", {}, text);
  if (places.length > 1)
    draw(group, "path", {
      class: "plan-between",
      d: path(
        places.map(({ position_m: [x, y] }) => [x, y]),
        false,
      ),
    });
  for (const {
    id,
    position_m: [x, y],
  } of places) {
    const place = draw(draw(group, "g", { transform: `translate(${xy([x, y])})` }), "g", {
      class: "plan-upright",
    });
    draw(place, "circle", { class: "plan-place", r: 10 });
    draw(place, "text", { class: "plan-place-name", "text-anchor": "middle", dy: "0.35em" }, id);
  }
}
