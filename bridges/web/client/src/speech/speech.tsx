/** What the chosen person says: the microphone, what was understood, and the answer to an open question. */

import type { Controls } from "../controls";
import { capital } from "../format";
import { Button, Icon } from "../ui/elements";
import { namedPart, type PanelPart } from "../ui/part";
import { Voice, type SaidWord } from "../voice";

/** Without a sentence that was understood, it is said after so long, ms, that there was none. */
const UNDERSTOOD_TIMEOUT_MS = 4000;
const NOBODY = "No command in that, or nobody follows: pointit listen";
/** Age at which the word of an answer by a button has begun, s. */
const ANSWER_AGE_S = 0.3;

export function speechPart(controls: Controls): PanelPart {
  const speech = new Speech(controls);
  return namedPart(
    "Speech",
    () => speech.canListen || (controls.person?.understood ?? null) !== null,
    () => <SpeechView controls={controls} speech={speech} />,
  );
}

/** The microphone of this page, and what was heard by it. */
class Speech {
  isListening = false;
  /** Sentence on what is heard now, or was. */
  heard = "";
  private waiting = "";
  private waitsUntilMs = 0;
  /** What was understood before the sentence that is awaited. */
  private before: unknown = null;
  private readonly voice: Voice;

  constructor(private readonly controls: Controls) {
    this.voice = new Voice({
      hearing: (text) => this.tell(`… ${text}`),
      said: (words) => void this.say(words),
      turned: (isOn, problem) => {
        this.isListening = isOn;
        const hint = isOn ? `Say what ${controls.user} means: take that, put that there, stop.` : "";
        this.tell(problem || hint);
      },
    });
  }

  get canListen(): boolean {
    return this.mayAnswer && this.voice.isThere;
  }

  get mayAnswer(): boolean {
    return this.controls.mayDo("speak") && this.controls.user !== "";
  }

  toggle(): void {
    this.voice.toggle();
  }

  answer(text: string): void {
    void this.say([{ text, start_s: ANSWER_AGE_S, end_s: 0, confidence: 1 }]);
  }

  /** Follow what was understood, and the permission to speak. */
  follow(): void {
    const understood = this.controls.person?.understood ?? null;
    if (!this.mayAnswer) this.voice.stop();
    if (understood !== this.before) this.waiting = "";
    const isLate = performance.now() > this.waitsUntilMs;
    if (!this.waiting || !isLate || understood?.result === "asked") return;
    this.heard = `“${this.waiting}”: ${NOBODY} ${this.controls.user}`;
    this.waiting = "";
  }

  private async say(words: SaidWord[]): Promise<void> {
    this.waiting = words.map(({ text }) => text).join(" ");
    this.before = this.controls.person?.understood ?? null;
    this.waitsUntilMs = performance.now() + UNDERSTOOD_TIMEOUT_MS;
    this.tell(`“${this.waiting}”`);
    await this.controls.ask({ deed: "speak", name: this.controls.user, query: { words } });
  }

  private tell(heard: string): void {
    this.heard = heard;
    this.controls.changed();
  }
}

function SpeechView({ controls, speech }: { controls: Controls; speech: Speech }) {
  speech.follow();
  const understood = controls.person?.understood ?? null;
  const isAsked = understood?.result === "asked" && controls.site.connected;
  return (
    <>
      {speech.canListen && (
        <button
          type="button"
          aria-pressed={speech.isListening}
          title="The browser recognises the words; some send the voice to their maker"
          onClick={() => speech.toggle()}
        >
          <Icon name="microphone" />
          <span>Listen</span>
        </button>
      )}
      <p class="muted" role="status">
        {speech.heard}
      </p>
      <p class="understood" role="status" data-result={understood?.result}>
        {understood && `“${understood.text}”: ${understood.message || understood.result}`}
      </p>
      {speech.mayAnswer && isAsked && (
        <div class="pairs">
          {["yes", "no"].map((text) => (
            <Button key={text} name={capital(text)} onClick={() => speech.answer(text)} />
          ))}
        </div>
      )}
    </>
  );
}
