/** The way into the plan editor, for operators; it is loaded when it is opened. */

import "./edit.css";
import type { Controls } from "../controls";
import { el, enable, icon, section, show } from "../dom";
import type { PanelPart } from "../panel/panel_part";

export function mapPart(controls: Controls): PanelPart {
  const button = el(
    "button",
    { type: "button", onclick: () => void open() },
    icon("map"),
    el("span", { text: "Edit the map" }),
  );
  const element = section("Map", button);

  async function open(): Promise<void> {
    enable(button, false);
    try {
      await (await import("./editor")).openEditor(controls);
    } finally {
      enable(button, true);
    }
  }

  return {
    element,
    update: () =>
      show(
        element,
        controls.mayDo("read_map") && controls.site.timeline === null && controls.isPresent("pui"),
      ),
  };
}
