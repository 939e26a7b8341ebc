/** Fields to choose whether, in which language and how fast names are spoken. */

import { RATES, type Speaker } from "../speaker";
import { Check, Field } from "../ui/elements";

export function SpeakerFields({ speaker }: { speaker: Speaker }) {
  return (
    <>
      <Check
        name="Speak the names of things I point at"
        isOn={speaker.isOn}
        onToggle={(on) => speaker.keep({ on })}
      />
      <Field name="Language">
        <select
          value={speaker.chosenLanguage}
          onChange={({ currentTarget }) => speaker.keep({ lang: currentTarget.value })}
        >
          {speaker.languages.map((language) => (
            <option key={language} value={language}>
              {language || "as the page"}
            </option>
          ))}
        </select>
      </Field>
      <Field name="Rate">
        <select
          value={String(speaker.rate)}
          onChange={({ currentTarget }) => speaker.keep({ rate: Number(currentTarget.value) })}
        >
          {RATES.map((rate) => (
            <option key={rate} value={String(rate)}>{`${rate} ×`}</option>
          ))}
        </select>
      </Field>
    </>
  );
}
