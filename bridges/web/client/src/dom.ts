/** The little that pages need to make elements; text only, never markup from strings. */

/** On a phone or tablet: a finger points, and a phone cannot scan its own screen. */
export const isTouch = (): boolean => matchMedia("(hover: none) and (pointer: coarse)").matches;

type Child = Node | string | null;
type Attributes = Record<string, string | number | boolean | ((event: Event) => void)>;

/**
 * Make an element: `on…` attributes are listeners, `true` sets a bare attribute, `false` leaves it out,
 * `className` and `text` are what they say. Clicks of what `enable` has switched off are dropped.
 */
export function el<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "onclick" && typeof value === "function")
      element.addEventListener("click", (event) => {
        if (isEnabled(element)) value(event);
      });
    else if (typeof value === "function") element.addEventListener(name.slice(2), value);
    else if (name === "text") element.textContent = String(value);
    else if (name === "className") element.className = String(value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false) element.setAttribute(name, String(value));
  }
  element.append(...children.filter((child): child is Node | string => child !== null));
  return element;
}

/** An icon of the sprite in index.html; decoration, so always beside a name. */
export function icon(name: string): SVGSVGElement {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("class", "icon");
  svg.setAttribute("aria-hidden", "true");
  const use = document.createElementNS("http://www.w3.org/2000/svg", "use");
  use.setAttribute("href", `#icon-${name}`);
  svg.append(use);
  return svg;
}

/** Set the text only if it differs: assistive technology announces changes. */
export function write(element: Element, text: string): void {
  if (element.textContent !== text) element.textContent = text;
}

/** Show or hide. */
export function show(element: HTMLElement, isShown: boolean): void {
  if (element.hidden === isShown) element.hidden = !isShown;
}

/** Set or take away an attribute, only when it differs. */
export function mark(element: Element, name: string, value: string | number | null): void {
  const text = value === null ? null : String(value);
  if (element.getAttribute(name) === text) return;
  if (text === null) element.removeAttribute(name);
  else element.setAttribute(name, text);
}

/**
 * Let a control act or not. It keeps the focus: browsers take it from one with the attribute `disabled`, and
 * who uses the keyboard then has to begin at the top of the page.
 */
export function enable(element: HTMLElement, isOn: boolean): void {
  mark(element, "aria-disabled", isOn ? null : "true");
}

/** Whether a control acts, see `enable`. */
export function isEnabled(element: Element): boolean {
  return element.getAttribute("aria-disabled") !== "true";
}

const CONTROLS = "a, button, input, select, summary, textarea, [tabindex]";

/**
 * Replace the children when `signature` has changed since the last time. A focus within goes on to the control
 * of the same name, else to the first one.
 */
export function renew(element: HTMLElement, signature: string, make: () => Child[]): void {
  if (element.dataset.signature === signature) return;
  element.dataset.signature = signature;
  const focused = document.activeElement;
  const hadFocus = focused !== null && focused !== element && element.contains(focused);
  element.replaceChildren(...make().filter((child): child is Node | string => child !== null));
  if (!hadFocus) return;
  const controls = [...element.querySelectorAll<HTMLElement>(CONTROLS)];
  const name = controlName(focused);
  const counterpart = controls.find((control) => controlName(control) === name);
  (counterpart ?? controls[0])?.focus();
}

/** Name by which a control is found again after its list was made anew. */
function controlName(control: Element): string {
  return control.getAttribute("name") ?? control.getAttribute("aria-label") ?? control.textContent ?? "";
}

/** A key as printed on its button; screen readers use `aria-keyshortcuts`. */
export function key(name: string): HTMLElement {
  return el("kbd", { "aria-hidden": "true", text: name });
}

/** A titled part of the panel. */
export function section(title: string, ...children: Child[]): HTMLElement {
  const id = `s-${title.toLowerCase().replaceAll(/[^a-z]+/g, "-")}`;
  return el(
    "section",
    { className: "part", "aria-labelledby": id },
    el("h2", { id, text: title }),
    ...children,
  );
}

let sheets = 0;

/** A dialog in the page, with a button that closes it; its title may be an element that is written later. */
export function sheet(title: string | HTMLElement, ...children: Child[]): HTMLDialogElement {
  const head = typeof title === "string" ? el("h2", { text: title }) : title;
  head.id ||= `sheet-${++sheets}`;
  const close = el(
    "button",
    { type: "button", className: "quiet", "aria-label": "Close", onclick: () => dialog.close() },
    icon("close"),
  );
  const dialog = el(
    "dialog",
    { className: "sheet", "aria-labelledby": head.id },
    el("header", {}, head, close),
    ...children,
  );
  document.body.append(dialog);
  return dialog;
}

/** A part that can be folded. */
export function folded(title: string, isOpen: boolean, ...children: Child[]): HTMLDetailsElement {
  return el(
    "details",
    { className: "part", open: isOpen },
    el("summary", {}, el("h2", { text: title }), icon("chevron")),
    el("div", { className: "inner" }, ...children),
  );
}
