"""Level crossings: an artificial immune system recognises danger and reacts, and its rivals.

Recognition, reaction and probability need no optional dependency; the geodesic distance, the
NSGA-II front, the exchange simulation and the drawings need the ``crossing`` extra.
"""

from railops.crossing.detectors import DetectorSet
from railops.crossing.fallback import Decision, Order, react
from railops.crossing.memory import Memory
from railops.crossing.probability import Approach, Uncertainty, collision_probability
from railops.crossing.problem import ActionRange, Problem, Reaction
from railops.crossing.rules import Crossing, can_stop, clearance
from railops.crossing.situation import SPACE, Situation

__all__ = [
    "SPACE",
    "ActionRange",
    "Approach",
    "Crossing",
    "Decision",
    "DetectorSet",
    "Memory",
    "Order",
    "Problem",
    "Reaction",
    "Situation",
    "Uncertainty",
    "can_stop",
    "clearance",
    "collision_probability",
    "react",
]
