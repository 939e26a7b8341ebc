/** SVG elements with as little said as possible; the plan's user unit is a centimetre, y down. */

const SVG = "http://www.w3.org/2000/svg";

export type Attributes = Readonly<Record<string, string | number>>;

/** Make an element within `parent`. */
export function draw<K extends keyof SVGElementTagNameMap>(
  parent: Element,
  name: K,
  attributes: Attributes = {},
  text = "",
): SVGElementTagNameMap[K] {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
  if (text) element.textContent = text;
  parent.append(element);
  return element;
}

/** Show or hide. */
export function show(element: Element, isShown: boolean): void {
  if (element.hasAttribute("display") === isShown) {
    if (isShown) element.removeAttribute("display");
    else element.setAttribute("display", "none");
  }
}

/** Metres in {W} to the plan's units, rounded to a tenth of a millimetre. */
export function cm(metres: number): number {
  return Math.round(metres * 10_000) / 100;
}

/** A place in {W} as the plan's `x y`. */
export function xy(at: readonly number[]): string {
  return `${cm(at[0] ?? 0)} ${cm(-(at[1] ?? 0))}`;
}

/** A closed or open path through places in {W}. */
export function path(points: readonly (readonly number[])[], isClosed = false): string {
  return points.length ? `M${points.map(xy).join("L")}${isClosed ? "Z" : ""}` : "";
}

/** A heading in {W}, rad, as a rotation of the plan, degrees. */
export function turned(yaw: number): number {
  return Math.round((-yaw * 18_000) / Math.PI) / 100;
}
