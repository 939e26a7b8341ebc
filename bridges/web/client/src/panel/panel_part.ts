/** A part of the panel: drawn once, then kept up to date a few times a second. */
export interface PanelPart {
  readonly element: HTMLElement;
  update(): void;
}
