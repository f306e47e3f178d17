"""The brake decision: error bounds that hold, and the train that has to stop."""

from railops.braking.bounds import Bound, bound, error_bound, largest_probability, trials_needed
from railops.braking.channels import joint_exceedance, measurements_needed
from railops.braking.decision import Action, Advice, Policy, RangeMeasurement, decide
from railops.braking.moments import BrakeMoment, BrakeMoments, brake_moments
from railops.braking.montecarlo import Campaign, Disturbances, StopLaw
from railops.braking.protection import Section, collision_bound, collision_probability
from railops.braking.stopping import Stop, stopping_distance
from railops.braking.train import Brake, Train

__all__ = [
    "Action",
    "Advice",
    "Bound",
    "Brake",
    "BrakeMoment",
    "BrakeMoments",
    "Campaign",
    "Disturbances",
    "Policy",
    "RangeMeasurement",
    "Section",
    "Stop",
    "StopLaw",
    "Train",
    "bound",
    "brake_moments",
    "collision_bound",
    "collision_probability",
    "decide",
    "error_bound",
    "joint_exceedance",
    "largest_probability",
    "measurements_needed",
    "stopping_distance",
    "trials_needed",
]
