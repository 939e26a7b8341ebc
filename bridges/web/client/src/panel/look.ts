/** The settings of the page, behind the gear: how it looks and sounds; kept by this browser. */

import { choice } from "../choice";
import type { Controls } from "../controls";
import { el, sheet } from "../dom";
import type { Settings } from "../settings";
import type { Speaker } from "../speaker";

export interface Look {
  open(): void;
  toggleSound(): void;
}

/** @param onChange called with the changed setting, after `settings` has it. */
export function makeLook(
  controls: Controls,
  speaker: Speaker,
  onChange: (what: keyof Settings) => void,
): Look {
  const { settings } = controls;
  const theme = choice(
    "Theme",
    (value) => {
      settings.theme = value as Settings["theme"];
      onChange("theme");
    },
    [
      { value: "auto", label: "Auto" },
      { value: "light", label: "Light", icon: "sun" },
      { value: "dark", label: "Dark", icon: "moon" },
    ],
  );
  const view = choice(
    "View",
    (value) => {
      settings.view = value as Settings["view"];
      onChange("view");
    },
    [
      { value: "auto", label: "Auto" },
      { value: "scene", label: "Scene", icon: "cube" },
      { value: "plan", label: "Plan", icon: "map" },
    ],
  );
  const check = (
    what: "sound" | "shortcuts",
    text: string,
  ): { box: HTMLInputElement; label: HTMLElement } => {
    const box = el("input", {
      type: "checkbox",
      onchange: () => {
        settings[what] = box.checked;
        onChange(what);
      },
    });
    return { box, label: el("label", { className: "check" }, box, el("span", { text })) };
  };
  const sound = check("sound", "Sounds, when I point");
  const keys = check("shortcuts", "Single keys do something (Escape, arrows and ? always do)");
  const names = el("div");
  const dialog = sheet(
    "Settings of this page",
    theme.element,
    view.element,
    sound.label,
    keys.label,
    names,
    el("p", { className: "muted", text: "This browser remembers them." }),
  );

  return {
    open() {
      theme.set(settings.theme);
      view.set(settings.view);
      sound.box.checked = settings.sound;
      keys.box.checked = settings.shortcuts;
      names.replaceChildren(speaker.fields()); // browsers know their voices late
      dialog.showModal();
    },
    toggleSound() {
      settings.sound = !settings.sound;
      onChange("sound");
      controls.toasts.show("info", settings.sound ? "Sounds are on." : "Sounds are off.", { topic: "sound" });
    },
  };
}
