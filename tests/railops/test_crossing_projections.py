"""Drawing the detector space."""

from pathlib import Path

import cv2
import pytest

from railops.crossing import projections, vdetector
from railops.crossing.published import ANTIGENS, SELF
from railops.errors import FileError


def test_both_published_pairs_are_drawn(tmp_path: Path) -> None:
    few = vdetector.train(SELF, 1, vdetector.Settings(detectors=5))
    projections.draw(tmp_path / "space.png", few, SELF, ANTIGENS)
    picture = cv2.imread(str(tmp_path / "space.png"))
    assert picture is not None
    assert picture.shape[1] > 1.5 * picture.shape[0]
    assert (picture.min(axis=2) < 200).any()
    with pytest.raises(FileError, match=r"cannot draw into .*space\.text"):
        projections.draw(tmp_path / "space.text", few, SELF, ANTIGENS)
