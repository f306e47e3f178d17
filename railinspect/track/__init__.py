"""Following the ego track: beginning points, vanishing point, region growing, smooth track."""

from railinspect.track.branches import Branch
from railinspect.track.follower import TrackFollower
from railinspect.track.geometry import Gap, RailProfile, TrackGeometry, TrackPath
from railinspect.track.settings import FollowerSettings
from railinspect.track.state import FollowerState

__all__ = [
    "Branch",
    "FollowerSettings",
    "FollowerState",
    "Gap",
    "RailProfile",
    "TrackFollower",
    "TrackGeometry",
    "TrackPath",
]
