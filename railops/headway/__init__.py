"""Regulating characteristics: the shortest departure interval for every pair of run times."""

from railops.headway.calibrate import Calibration, Unknowns, calibrate
from railops.headway.characteristic import Characteristic, characteristic
from railops.headway.control import Order, Passage, Plan, choose_run_time, regulate_line
from railops.headway.files import content_hash, find_section, load_section, save_section
from railops.headway.interval import Interval, Succession, bracketed_interval, minimum_interval
from railops.headway.protection import FixedBlock, MovingBlock, TrackCircuits
from railops.headway.regulator import Regulator, Run, RunTimeError, StuckError
from railops.headway.section import Dwell, Section
from railops.headway.simulation import Simulation, simulate
from railops.headway.stock import Stock

__all__ = [
    "Calibration",
    "Characteristic",
    "Dwell",
    "FixedBlock",
    "Interval",
    "MovingBlock",
    "Order",
    "Passage",
    "Plan",
    "Regulator",
    "Run",
    "RunTimeError",
    "Section",
    "Simulation",
    "Stock",
    "StuckError",
    "Succession",
    "TrackCircuits",
    "Unknowns",
    "bracketed_interval",
    "calibrate",
    "characteristic",
    "choose_run_time",
    "content_hash",
    "find_section",
    "load_section",
    "minimum_interval",
    "regulate_line",
    "save_section",
    "simulate",
]
