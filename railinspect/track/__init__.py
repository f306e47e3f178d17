"""Following the ego track: beginning points, vanishing point, region growing, smooth track."""

from railinspect.track.follower import FollowerState, TrackFollower
from railinspect.track.geometry import Gap, RailProfile, TrackGeometry, TrackPath
from railinspect.track.settings import FollowerSettings

__all__ = [
    "FollowerSettings",
    "FollowerState",
    "Gap",
    "RailProfile",
    "TrackFollower",
    "TrackGeometry",
    "TrackPath",
]
