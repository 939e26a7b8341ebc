/** The way to the page that maps the room by a camera. */

import type { Controls } from "../controls";
import { el, icon, section, show } from "../dom";
import { pairingDialog } from "./pairing";
import type { PanelPart } from "./panel_part";

export function mapRoomPart(controls: Controls): PanelPart {
  const phone = pairingDialog(controls, "map_room");
  const element = section(
    "Map this room",
    el("p", {
      className: "muted",
      text: "The strips blink, a camera sees where they are, and a new map is written.",
    }),
    el(
      "button",
      { type: "button", onclick: () => phone.open() },
      icon("phone"),
      el("span", { text: "With a phone" }),
    ),
    el(
      "a",
      { className: "button", href: "/scan", target: "_blank" },
      el("span", { text: "With this computer's camera" }),
    ),
  );
  return {
    element,
    update() {
      show(element, controls.mayDo("map_room") && Boolean(controls.site.map?.strips.length));
    },
  };
}
