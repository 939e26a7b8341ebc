/** Numbers as people read them. */

/** `7 s`, `3 min`, `2 h 05 min`, `4 d`. */
export function duration(seconds: number): string {
  const s = Math.max(0, Math.floor(seconds));
  if (s < 60) return `${s} s`;
  if (s < 3600) return `${Math.floor(s / 60)} min`;
  if (s < 86_400)
    return `${Math.floor(s / 3600)} h ${String(Math.floor((s % 3600) / 60)).padStart(2, "0")} min`;
  return `${Math.floor(s / 86_400)} d`;
}

/** `12 ms`, `3.4 s`; a dash for nothing. */
export function milliseconds(ms: number | null): string {
  if (ms === null) return "–";
  return ms < 1000 ? `${Math.round(ms)} ms` : `${(ms / 1000).toFixed(1)} s`;
}

/** Rounded to what matters: `0.034`, `1.2`, `15`; no minus without a digit behind it. */
export function figure(value: number): string {
  const size = Math.abs(value);
  const digits = size >= 10 || size === 0 ? 0 : size >= 1 ? 1 : size >= 0.1 ? 2 : 3;
  const text = value.toFixed(digits);
  return /^-0\.?0*$/.test(text) ? text.slice(1) : text;
}

/** Time of the day, `14:03:07`. */
export function time(unixMs: number): string {
  const t = new Date(unixMs);
  return [t.getHours(), t.getMinutes(), t.getSeconds()]
    .map((part) => String(part).padStart(2, "0"))
    .join(":");
}

/** `1.2 kB`, `3.4 MB`. */
export function bytes(count: number): string {
  if (count < 1000) return `${Math.round(count)} B`;
  return count < 1e6 ? `${(count / 1e3).toFixed(count < 1e4 ? 1 : 0)} kB` : `${(count / 1e6).toFixed(1)} MB`;
}

/** Label of an axis of ms, of six characters at most: `200`, `12.5 s`. */
export function latencyTick(ms: number): string {
  return ms < 1000 ? String(ms) : `${Number((ms / 1000).toFixed(1))} s`;
}

/** First letter in capitals. */
export function capital(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

/** First letter in capitals, a full stop at the end. */
export function sentence(text: string): string {
  const trimmed = text.trim();
  if (!trimmed) return "";
  const whole = /[.!?…]$/.test(trimmed) ? trimmed : `${trimmed}.`;
  return capital(whole);
}

/** Names in counting order: user2 before user10. */
export function byName(a: string, b: string): number {
  return a.localeCompare(b, "en", { numeric: true });
}

/** Name of the renderer in WebGL's description: `SwiftShader`, `NVIDIA GeForce RTX 3060`. */
export function rendererName(text: string): string {
  const inner = /^ANGLE \((.*)\)$/.exec(text)?.[1] ?? text;
  if (/SwiftShader/i.test(inner)) return "SwiftShader";
  const parts = inner.split(", ");
  return (parts[1] ?? inner)
    .replace(/^ANGLE Metal Renderer: /, "")
    .replace(/ \(0x[0-9A-F]+\)/i, "")
    .replace(/ (Direct3D|OpenGL|Vulkan).*$/, "");
}

/** Number that a person typed, with a comma or a point, and with or without `unit` behind it; null if it is none. */
export function typedNumber(text: string, unit: string): number | null {
  const bare = text
    .trim()
    .replace(/\u2212/g, "-")
    .toLowerCase();
  const end = unit.toLowerCase();
  const number = (bare.endsWith(end) ? bare.slice(0, -end.length) : bare).trim().replace(",", ".");
  return /^[+-]?(\d+\.?\d*|\.\d+)$/.test(number) ? Number(number) : null;
}
