"""Times that this person takes to find and choose, and lapses."""

import math

import numpy as np

from pointit.services.user_sim.config import UserSimConfig

UNSKILLED_SHARE = 0.3
"""Share by which times shrink from skill 0 to 1."""


class DecisionTimes:
    """Random times of one person's decisions, log-normal, and lapses.

    Visual search has a base and a slope per item (Wolfe 1998: 5 to 10 ms if a colour pops out, 20 to 30 ms if
    features are conjoined, more for moving things in a room). Choosing among n targets takes 0.15 s per bit
    of log2(n + 1) (Hick 1952).
    """

    def __init__(self, config: UserSimConfig, skill: float, rng: np.random.Generator) -> None:
        """Create from the person's configuration and skill, 0 to 1."""
        self._decision = config.mind
        self._rng = rng
        self.quickness = 1.0 - UNSKILLED_SHARE * skill
        """Factor on times."""
        self._lapse_share = config.mind.lapse_share * (1.0 - skill)

    def find_s(self, items: int, choices: int) -> float:
        """Return the time to find a target among `items`, of which `choices` are suitable, s."""
        decision = self._decision
        usual_s = decision.search_base_s + decision.search_per_item_s * items
        usual_s += decision.decide_per_bit_s * math.log2(choices + 1.0)
        return (
            self.quickness * usual_s * math.exp(decision.search_spread * float(self._rng.standard_normal()))
        )

    def lapses(self) -> bool:
        """Return True if a lapse occurs now."""
        return self._lapse_share > 0.0 and float(self._rng.random()) < self._lapse_share

    def between(self, minimum: float, maximum: float) -> float:
        """Return a uniformly random number between the two."""
        return float(self._rng.uniform(minimum, maximum))
