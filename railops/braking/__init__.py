"""The brake decision: error bounds that hold, and the train that has to stop."""

from railops.braking.decision import Action, Advice, Policy, RangeMeasurement, decide
from railops.braking.stopping import Stop, stopping_distance
from railops.braking.train import Brake, Train

__all__ = [
    "Action",
    "Advice",
    "Brake",
    "Policy",
    "RangeMeasurement",
    "Stop",
    "Train",
    "decide",
    "stopping_distance",
]
