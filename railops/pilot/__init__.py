"""The pilot vehicle: reference gap, tracking, and what it is worth in a mission.

Planning needs CasADi (``pip install 'railinspect[pilot]'``); missions do not.
"""

from railops.pilot.camera import Optics, braking_distance, lateral_shift
from railops.pilot.controllers import Mpc, Pid
from railops.pilot.leg import Leg, Objective
from railops.pilot.mission import Camera, Campaign, Driver, Mission, Radio, simulate
from railops.pilot.pareto import Compromise, pareto_sweep
from railops.pilot.plan import DEFAULT_MESH, PAPER_MESH, LegPlan, Mesh, Tolerance, plan_leg
from railops.pilot.reference import Reference
from railops.pilot.route import Route, SpeedProfile
from railops.pilot.tracking import Reality, Track, track
from railops.pilot.trip import Trip, TripPlan, plan_trip
from railops.pilot.vehicle import PilotVehicle

__all__ = [
    "DEFAULT_MESH",
    "PAPER_MESH",
    "Camera",
    "Campaign",
    "Compromise",
    "Driver",
    "Leg",
    "LegPlan",
    "Mesh",
    "Mission",
    "Mpc",
    "Objective",
    "Optics",
    "Pid",
    "PilotVehicle",
    "Radio",
    "Reality",
    "Reference",
    "Route",
    "SpeedProfile",
    "Tolerance",
    "Track",
    "Trip",
    "TripPlan",
    "braking_distance",
    "lateral_shift",
    "pareto_sweep",
    "plan_leg",
    "plan_trip",
    "simulate",
    "track",
]
