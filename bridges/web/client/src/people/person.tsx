/** The person of the controls, where there are several. */

import type { Controls } from "../controls";
import { byName } from "../format";
import { cssColor } from "../geometry/appearance";
import { Choice } from "../ui/choice";
import type { Option } from "../ui/columns";
import { namedPart, type PanelPart } from "../ui/part";

export function personPart(controls: Controls): PanelPart {
  return namedPart(
    "Person",
    () => controls.site.people.size > 1,
    () => <ChoosePerson controls={controls} />,
  );
}

function ChoosePerson({ controls }: { controls: Controls }) {
  const { people } = controls.site;
  const users = [...people.keys()].sort(byName);
  const option = (user: string): Option => {
    const profile = people.get(user)?.profile;
    const named = { value: user, label: user };
    return profile ? { ...named, swatch: cssColor(profile.cursor_color) } : named;
  };
  return (
    <Choice
      legend="Person"
      class="people"
      options={users.map(option)}
      value={controls.user}
      onChoose={(user) => controls.choose(user)}
    />
  );
}
