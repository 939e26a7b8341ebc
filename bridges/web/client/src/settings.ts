/** What this browser remembers of the page. */

export interface Settings {
  theme: "auto" | "light" | "dark";
  view: "auto" | "scene" | "plan";
  sound: boolean;
  /** Single keys do something. */
  shortcuts: boolean;
}

const USUAL: Settings = { theme: "auto", view: "auto", sound: true, shortcuts: true };
const NAME = "pointit";

/** Return the stored settings, with defaults for invalid or missing ones. */
export function readSettings(kept: string | null): Settings {
  const settings: Settings = { ...USUAL };
  try {
    const found = JSON.parse(kept ?? "{}") as Partial<Record<keyof Settings, unknown>>;
    if (found.theme === "light" || found.theme === "dark") settings.theme = found.theme;
    if (found.view === "scene" || found.view === "plan") settings.view = found.view;
    if (typeof found.sound === "boolean") settings.sound = found.sound;
    if (typeof found.shortcuts === "boolean") settings.shortcuts = found.shortcuts;
  } catch {
    // what is not ours counts as nothing
  }
  return settings;
}

export function loadSettings(): Settings {
  try {
    return readSettings(localStorage.getItem(NAME));
  } catch {
    return readSettings(null); // storage may be forbidden
  }
}

export function keepSettings(settings: Settings): void {
  try {
    localStorage.setItem(NAME, JSON.stringify(settings));
  } catch {
    // then they last as long as the page
  }
}
