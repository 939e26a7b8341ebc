/** Light or dark: as the system has it, or as chosen. */

import type { Settings } from "./settings";

const system = matchMedia("(prefers-color-scheme: dark)");

export function isDark(theme: Settings["theme"]): boolean {
  return theme === "auto" ? system.matches : theme === "dark";
}

/** Put the theme on the page. */
export function applyTheme(theme: Settings["theme"]): void {
  document.documentElement.dataset.theme = isDark(theme) ? "dark" : "light";
}

/** Call `onChange` when the system changes over. */
export function watchSystem(onChange: () => void): void {
  system.addEventListener("change", onChange);
}
