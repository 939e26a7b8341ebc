/** Devices in a reply of the server, names for who wears them, and figures of connected wrists; pure. */

import { byName } from "../format";
import type { Health } from "../messages";
import type { DeviceLine } from "../wire";

export interface FoundDevice {
  kind: "wrist" | "light";
  plugin: string;
  address: string;
  label: string;
  /** Of a light; 0 if it does not say. */
  pixels: number;
  /** Option of `pointit run` that chooses it. */
  use: string;
}

/** The devices in a reply, whatever it holds. */
export function foundDevices(reply: Record<string, unknown>): FoundDevice[] {
  const listed: unknown = reply["devices"];
  if (!Array.isArray(listed)) return [];
  return listed.flatMap((each: unknown) => {
    const { kind, plugin, address, label, pixels, use } = (each ?? {}) as Partial<Record<string, unknown>>;
    if (
      (kind !== "wrist" && kind !== "light") ||
      ![plugin, address, label, use].every((text) => typeof text === "string")
    )
      return [];
    return [
      {
        kind,
        plugin: String(plugin),
        address: String(address),
        label: String(label),
        use: String(use),
        pixels: Number(pixels) || 0,
      },
    ];
  });
}

/** A Home Assistant, and the command that imports its lamps and switches. */
export interface FoundHome {
  label: string;
  command: string;
}

/** The Home Assistants in a reply, whatever it holds. */
export function foundHomes(reply: Record<string, unknown>): FoundHome[] {
  const listed: unknown = reply["homes"];
  if (!Array.isArray(listed)) return [];
  return listed.flatMap((each: unknown) => {
    const { label, command } = (each ?? {}) as Partial<Record<string, unknown>>;
    return typeof label === "string" && typeof command === "string" ? [{ label, command }] : [];
  });
}

/** The command that connects a device from a terminal. */
export function command({ kind, use }: FoundDevice): string {
  return kind === "wrist"
    ? `pointit person add NAME ${use}`
    : `pointit output add ${use.replace(/^--output /, "")}`;
}

/** Whether a device that was found is connected, by `lines`. */
export function isConnected(found: FoundDevice, lines: readonly DeviceLine[]): boolean {
  return lines.some(
    (line) => line.kind === found.kind && line.plugin === found.plugin && line.address === found.address,
  );
}

/** A name that nobody has yet, such as `user2`. */
export function freeName(taken: readonly string[]): string {
  for (let number = 1; ; number++) if (!taken.includes(`user${number}`)) return `user${number}`;
}

/**
 * A name that nobody has yet for who will wear `wrist`, one of the `wrists` that are offered: each of them has a name
 * of its own, so that two of them cannot be connected as one person.
 */
export function freeNameFor(
  wrist: FoundDevice,
  wrists: readonly FoundDevice[],
  taken: readonly string[],
): string {
  const names = [...taken];
  for (const each of wrists) {
    if (each.plugin === wrist.plugin && each.address === wrist.address) break;
    names.push(freeName(names));
  }
  return freeName(names);
}

/** Maximum length of a strip's name that is taken from its light's own. */
const MAX_STRIP_CHARACTERS = 60;

/** Name of a strip for a light, after the light's own, that no strip of the map has. */
export function newStripName({ label }: FoundDevice, strips: readonly { id: string }[]): string {
  const base = label.split(",")[0]!.trim().slice(0, MAX_STRIP_CHARACTERS) || "light";
  const taken = strips.map(({ id }) => id);
  let name = base;
  for (let number = 2; taken.includes(name); number++) name = `${base} ${number}`;
  return name;
}

/** Strips of the map, given their ids and pixels, that no connected light shows. */
export function freeStrips<S extends { id: string }>(
  strips: readonly S[],
  lines: readonly DeviceLine[],
): S[] {
  const taken = lines.filter(({ kind }) => kind === "light").map(({ name }) => name);
  return strips.filter(({ id }) => !taken.includes(id)).sort((a, b) => byName(a.id, b.id));
}

/** Rate and battery of a wrist, as far as it tells them. */
export function wristFigures(health: Health | undefined): string {
  const value = (name: string): number | undefined =>
    health?.figures.find((figure) => figure.name === name)?.value;
  const rate = value("rate");
  const battery = value("battery");
  return [
    rate === undefined ? "" : `${Math.round(rate)} Hz`,
    battery === undefined ? "" : `battery ${Math.round(battery)} %`,
  ]
    .filter(Boolean)
    .join(" · ");
}
