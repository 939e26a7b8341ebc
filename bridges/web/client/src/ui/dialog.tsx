/** Dialogs over the page. */

import { render, type ComponentChildren } from "preact";
import { useLayoutEffect, useRef } from "preact/hooks";
import { Icon } from "./elements";
import { useOwnId } from "./ids";

interface DialogProps {
  title: string;
  isOpen: boolean;
  /** It was closed by its button or by Escape. */
  onClose(): void;
  children: ComponentChildren;
}

/** A dialog with a title and a button that closes it. Its content is there only while it is open. */
export function Dialog({ title, isOpen, onClose, children }: DialogProps) {
  const dialog = useRef<HTMLDialogElement>(null);
  const id = useOwnId("dialog");
  useLayoutEffect(() => {
    const element = dialog.current!;
    if (isOpen && !element.open) element.showModal();
    if (!isOpen && element.open) element.close();
  }, [isOpen]);
  return (
    <dialog class="sheet" aria-labelledby={id} ref={dialog} onClose={onClose}>
      <header>
        <h2 id={id}>{title}</h2>
        <button type="button" class="quiet" aria-label="Close" onClick={() => dialog.current!.close()}>
          <Icon name="close" />
        </button>
      </header>
      {isOpen && children}
    </dialog>
  );
}

/**
 * A place in the page for a dialog that several controls open. Returns the function that draws it, to be called
 * after each change of what it shows.
 */
export function placeDialog(content: () => ComponentChildren): () => void {
  let place: HTMLElement | null = null;
  return () => {
    place ??= document.body.appendChild(document.createElement("div"));
    render(content(), place);
  };
}
