/** How the page looks and sounds; kept by this browser. */

import { choice } from "../choice";
import type { Controls } from "../controls";
import { el, folded } from "../dom";
import type { Settings } from "../settings";
import type { Part } from "./part";

export interface Look extends Part {
  toggleSound(): void;
}

/** @param onChange called with the changed setting, after `settings` has it. */
export function lookPart(controls: Controls, onChange: (what: keyof Settings) => void): Look {
  const { settings } = controls;
  const theme = choice("Theme", (value) => {
    settings.theme = value as Settings["theme"];
    onChange("theme");
  }, [{ value: "auto", label: "Auto" }, { value: "light", label: "Light", icon: "sun" }, { value: "dark", label: "Dark", icon: "moon" }]);
  const view = choice("View", (value) => {
    settings.view = value as Settings["view"];
    onChange("view");
  }, [{ value: "auto", label: "Auto" }, { value: "scene", label: "Scene", icon: "cube" }, { value: "plan", label: "Plan", icon: "map" }]);
  const sound = el("input", { type: "checkbox", onchange: () => setSound(sound.checked) });
  const element = folded("Page", false, theme.element, view.element,
    el("label", { className: "check" }, sound, el("span", { text: "Sounds, when I point" })));

  function setSound(isOn: boolean): void {
    settings.sound = isOn;
    onChange("sound");
  }

  return {
    element,
    toggleSound() {
      setSound(!settings.sound);
      controls.toasts.show("info", settings.sound ? "Sounds are on." : "Sounds are off.");
    },
    update() {
      theme.set(settings.theme);
      view.set(settings.view);
      if (sound.checked !== settings.sound) sound.checked = settings.sound;
    },
  };
}
