/** The settings of the page, behind the gear: how it looks and sounds; kept by this browser. */

import type { Controls } from "../controls";
import type { Settings } from "../settings";
import type { Speaker } from "../speaker";
import { Choice } from "../ui/choice";
import { Dialog, placeDialog } from "../ui/dialog";
import { Check } from "../ui/elements";
import { SpeakerFields } from "./speaker_fields";

const THEMES = [
  { value: "auto", label: "Auto" },
  { value: "light", label: "Light", icon: "sun" },
  { value: "dark", label: "Dark", icon: "moon" },
];
const VIEWS = [
  { value: "auto", label: "Auto" },
  { value: "scene", label: "Scene", icon: "cube" },
  { value: "plan", label: "Plan", icon: "map" },
];

export class SettingsDialog {
  private isOpen = false;
  private readonly draw = placeDialog(() => this.view());

  /** @param onChange called with the changed setting, after `settings` has it. */
  constructor(
    private readonly controls: Controls,
    private readonly speaker: Speaker,
    private readonly onChange: (what: keyof Settings) => void,
  ) {
    speaker.onChange = () => {
      if (this.isOpen) this.draw();
    };
  }

  open(): void {
    this.isOpen = true;
    this.draw();
  }

  toggleSound(): void {
    const { settings, toasts } = this.controls;
    this.set("sound", !settings.sound);
    toasts.show("info", settings.sound ? "Sounds are on." : "Sounds are off.", { topic: "sound" });
  }

  private close(): void {
    this.isOpen = false;
    this.draw();
  }

  private set<K extends keyof Settings>(name: K, value: Settings[K]): void {
    this.controls.settings[name] = value;
    this.onChange(name);
    this.draw();
  }

  private view() {
    const { settings } = this.controls;
    return (
      <Dialog title="Settings of this page" isOpen={this.isOpen} onClose={() => this.close()}>
        <Choice
          legend="Theme"
          options={THEMES}
          value={settings.theme}
          onChoose={(value) => this.set("theme", value as Settings["theme"])}
        />
        <Choice
          legend="View"
          options={VIEWS}
          value={settings.view}
          onChoose={(value) => this.set("view", value as Settings["view"])}
        />
        <Check
          name="Sounds, when I point"
          isOn={settings.sound}
          onToggle={(isOn) => this.set("sound", isOn)}
        />
        <Check
          name="Single keys do something (Escape, arrows and ? always do)"
          isOn={settings.shortcuts}
          onToggle={(isOn) => this.set("shortcuts", isOn)}
        />
        <SpeakerFields speaker={this.speaker} />
        <p class="muted">This browser remembers them.</p>
      </Dialog>
    );
  }
}
