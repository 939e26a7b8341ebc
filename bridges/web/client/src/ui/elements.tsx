/** Small elements that all components share: icons, keys, buttons, titled parts, figures. */

import type { ComponentChildren, Ref } from "preact";

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
  /** Name that is read out, where the one that is seen is too short. */
  label?: string;
  /** Reason why it is off, or what it does. */
  title?: string;
  id?: string;
  ref?: Ref<HTMLButtonElement>;
  autofocus?: boolean;
}

export function Button(props: ButtonProps) {
  const { name, icon, kind = "", shortcut, isOff = false, hidden = false } = props;
  const act = (): void => {
    if (!isOff) props.onClick();
  };
  return (
    <button
      type="button"
      id={props.id}
      ref={props.ref ?? null}
      title={props.title || undefined}
      aria-label={props.label}
      autofocus={props.autofocus}
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

interface LinkButtonProps {
  name: string;
  icon: string;
  href: string;
  target?: "_blank";
  /** Name of the file to which what is there is saved. */
  download?: string;
}

/** A link that looks like a button. */
export function LinkButton({ name, icon, ...link }: LinkButtonProps) {
  return (
    <a class="button" {...link}>
      <Icon name={icon} />
      <span>{name}</span>
    </a>
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

/** A field to fill in, with its name. */
export function Field({ name, children }: { name: string; children: ComponentChildren }) {
  return (
    <label class="field">
      <span>{name}</span>
      {children}
    </label>
  );
}

interface CheckProps {
  name: string;
  isOn: boolean;
  onToggle(isOn: boolean): void;
}

/** A box to tick, with its name. */
export function Check({ name, isOn, onToggle }: CheckProps) {
  return (
    <label class="check">
      <input
        type="checkbox"
        checked={isOn}
        onChange={({ currentTarget }) => onToggle(currentTarget.checked)}
      />
      <span>{name}</span>
    </label>
  );
}
