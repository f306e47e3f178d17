"""The RailInspect generator: anomalies put into pictures of clear tracks, with their truth."""

from railinspect.anomalies.build import BuildPlan, Composition, build
from railinspect.anomalies.cutouts import Cutout, read_cutouts
from railinspect.anomalies.distort import Distortion, distort
from railinspect.anomalies.ego import (
    EgoTrack,
    NoTrackError,
    track_of_mask,
    track_of_rails,
    track_of_world,
)
from railinspect.anomalies.generate import Generated, GeneratorSettings, generate, place
from railinspect.anomalies.library import built_in
from railinspect.anomalies.manifest import (
    AnomalyType,
    ManifestEntry,
    read_manifest,
    write_manifest,
)
from railinspect.anomalies.sources import Base, FolderSource, WorldSource

__all__ = [
    "AnomalyType",
    "Base",
    "BuildPlan",
    "Composition",
    "Cutout",
    "Distortion",
    "EgoTrack",
    "FolderSource",
    "Generated",
    "GeneratorSettings",
    "ManifestEntry",
    "NoTrackError",
    "WorldSource",
    "build",
    "built_in",
    "distort",
    "generate",
    "place",
    "read_cutouts",
    "read_manifest",
    "track_of_mask",
    "track_of_rails",
    "track_of_world",
    "write_manifest",
]
