"""The RailInspect generator: anomalies put into pictures of clear tracks, with their truth."""

from railinspect.anomalies.manifest import (
    AnomalyType,
    ManifestEntry,
    read_manifest,
    write_manifest,
)

__all__ = ["AnomalyType", "ManifestEntry", "read_manifest", "write_manifest"]
