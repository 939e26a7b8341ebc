/** Small elements that all components share: icons, keys, buttons, titled parts, figures. */

import type { ComponentChildren } from "preact";

/** An icon of the sprite in index.html; decoration, so always beside a name. */
export function Icon({ name }: { name: string }) {
  return (
    <svg class="icon" aria-hidden="true">
      <use href={`#icon-${name}`} />
    </svg>
  );
}

/** A key as printed on its button; screen readers use `aria-keyshortcuts`. */
export function Key({ name }: { name: string }) {
  return <kbd aria-hidden="true">{name}</kbd>;
}

interface ButtonProps {
  name: string;
  onClick(): void;
  icon?: string;
  kind?: "primary" | "quiet" | "";
  /** Key that does the same. */
  shortcut?: string;
  /** It does nothing now, and keeps the focus, which browsers take from what is `disabled`. */
  isOff?: boolean;
  hidden?: boolean;
  class?: string;
}

export function Button(props: ButtonProps) {
  const { name, icon, kind = "", shortcut, isOff = false, hidden = false } = props;
  const act = (): void => {
    if (!isOff) props.onClick();
  };
  return (
    <button
      type="button"
      class={[kind, props.class].filter(Boolean).join(" ")}
      hidden={hidden}
      aria-disabled={isOff ? "true" : undefined}
      aria-keyshortcuts={shortcut}
      onClick={act}
    >
      {icon && <Icon name={icon} />}
      {icon ? <span>{name}</span> : name}
      {shortcut && <Key name={shortcut} />}
    </button>
  );
}

/** Id of the heading of a part. */
export function headingId(title: string): string {
  return `s-${title.toLowerCase().replaceAll(/[^a-z]+/g, "-")}`;
}

/** A titled part of the panel. */
export function Section({ title, children }: { title: string; children: ComponentChildren }) {
  const id = headingId(title);
  return (
    <section class="part" aria-labelledby={id}>
      <h2 id={id}>{title}</h2>
      {children}
    </section>
  );
}

/** Figures with their names, side by side. */
export function Tiles({ children }: { children: ComponentChildren }) {
  return <dl class="tiles">{children}</dl>;
}

/** One figure; a dash for nothing. */
export function Tile({ name, children }: { name: string; children: string | null }) {
  return (
    <div>
      <dt>{name}</dt>
      <dd>{children ?? "–"}</dd>
    </div>
  );
}
