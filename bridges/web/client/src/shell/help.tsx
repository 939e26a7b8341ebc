/** `?`: help and keyboard shortcuts. */

import { useState } from "preact/hooks";
import { now, type Shortcut } from "../keys";
import { Dialog, placeDialog } from "../ui/dialog";
import { Icon } from "../ui/elements";
import { wordsOf, type Word } from "./glossary_words";

type Gesture = readonly [name: string, does: string];

export class Help {
  private isOpen = false;
  private readonly draw = placeDialog(() => (
    <Dialog title="Help" isOpen={this.isOpen} onClose={() => this.set(false)}>
      <p>
        A sensor on a person's wrist measures where their arm points. Light on the strips shows the target,
        and dwelling on an object selects it. With the mouse you move the arm yourself.
      </p>
      <Keys gestures={this.gestures()} shortcuts={this.shortcuts().filter((each) => each.isOffered())} />
      <p class="muted">The settings of this page switch single keys off.</p>
      <AboutThisPage />
    </Dialog>
  ));

  constructor(
    private readonly shortcuts: () => readonly Shortcut[],
    private readonly gestures: () => readonly Gesture[],
  ) {}

  open(): void {
    this.set(true);
  }

  private set(isOpen: boolean): void {
    this.isOpen = isOpen;
    this.draw();
  }
}

interface KeysProps {
  gestures: readonly Gesture[];
  shortcuts: readonly Shortcut[];
}

function Keys({ gestures, shortcuts }: KeysProps) {
  return (
    <table class="keys">
      <caption class="unseen">Keys</caption>
      <thead class="unseen">
        <tr>
          <th scope="col">Key</th>
          <th scope="col">What it does</th>
        </tr>
      </thead>
      <tbody>
        {gestures.map(([name, does]) => (
          <KeyRow key={does} names={[name]} does={does} />
        ))}
        {shortcuts.map(({ shown, does }) => (
          <KeyRow key={now(does)} names={now(shown).split(" ")} does={now(does)} />
        ))}
      </tbody>
    </table>
  );
}

function KeyRow({ names, does }: { names: readonly string[]; does: string }) {
  return (
    <tr>
      <th scope="row">
        {names.map((name) => (
          <kbd key={name}>{name}</kbd>
        ))}
      </th>
      <td>{does}</td>
    </tr>
  );
}

/** The glossary and the licences. A page that plays without a server has its licences in itself, and no glossary. */
function AboutThisPage() {
  const licences = document.getElementById("licences");
  if (licences)
    return (
      <details>
        <summary>
          Licences of this page's components
          <Icon name="chevron" />
        </summary>
        <pre>{licences.textContent}</pre>
      </details>
    );
  return (
    <>
      <Glossary />
      <p class="muted">
        Licences of this page's components:{" "}
        <a href="/static/LICENSES.txt" target="_blank" rel="noreferrer">
          LICENSES.txt
        </a>
      </p>
    </>
  );
}

/** The words, which are fetched when this is opened first. */
function Glossary() {
  const [words, setWords] = useState<readonly Word[]>([]);
  const [status, setStatus] = useState("");

  async function load(): Promise<void> {
    setStatus("Loading …");
    try {
      const answer = await fetch("/static/glossary.md");
      if (!answer.ok) throw new Error(answer.statusText);
      setWords(wordsOf(await answer.text()));
      setStatus("");
    } catch {
      setStatus(
        "The words could not be loaded. Is PointIt still running? Close this part and open it again.",
      );
    }
  }

  return (
    <details
      class="words"
      onToggle={({ currentTarget }) => {
        if (currentTarget.open && words.length === 0) void load();
      }}
    >
      <summary>
        <span>What the words mean</span>
        <Icon name="chevron" />
      </summary>
      <p class="muted" role="status">
        {status}
      </p>
      <dl>
        {words.flatMap(({ word, meaning }) => [
          <dt key={word}>{word}</dt>,
          <dd key={`${word}:`}>{meaning}</dd>,
        ])}
      </dl>
    </details>
  );
}
