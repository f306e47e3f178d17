import numpy as np

from railinspect import labels


def test_names_colours_and_ids_belong_together() -> None:
    assert len(labels.CLASSES) == len(labels.PALETTE) == 19
    assert labels.CLASSES[labels.RAIL_RAISED] == "rail-raised"
    assert labels.CLASSES[labels.HUMAN] == "human"
    assert len({tuple(colour) for colour in labels.PALETTE.tolist()}) == 19


def test_colourise_paints_void_black() -> None:
    mask = np.array([[labels.ROAD, labels.VOID], [labels.SKY, 200]], np.uint8)
    painted = labels.colourise(mask)
    assert painted[0, 0].tolist() == [128, 64, 128]
    assert painted[0, 1].tolist() == [0, 0, 0]
    assert painted[1, 1].tolist() == [0, 0, 0]
