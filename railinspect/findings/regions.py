"""Regions of a mask: where they meet the image of the ground, and which pixels hang together."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt


@numba.njit(cache=True)
def contacts(
    mask: npt.NDArray[np.uint8], kind: npt.NDArray[np.uint8], first: int
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Rows and columns, from row ``first`` on, where the mask ends below and nothing stands there.

    People hide things and things hide people: neither ends in a foot on the other.
    """
    height, width = mask.shape
    found = []
    for row in range(first, height):
        for column in range(width):
            if mask[row, column] != 1:
                continue
            ends = row == height - 1
            if ends or (mask[row + 1, column] == 0 and kind[row + 1, column] == 0):
                found.append((row, column))
    rows, columns = np.empty(len(found), np.intp), np.empty(len(found), np.intp)
    for i, (row, column) in enumerate(found):
        rows[i], columns[i] = row, column
    return rows, columns


@numba.njit(cache=True)
def components(
    mask: npt.NDArray[np.uint8], rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.intp]]:
    """Components of the mask these pixels lie in, numbered from 1, and every number's area."""
    height, width = mask.shape
    number = np.zeros((height, width), np.int32)
    stack = np.empty((np.count_nonzero(mask), 2), np.intp)
    areas = [0]
    for seed in range(len(rows)):
        if number[rows[seed], columns[seed]] != 0:
            continue
        label, area, depth = len(areas), 0, 1
        stack[0, 0], stack[0, 1] = rows[seed], columns[seed]
        number[rows[seed], columns[seed]] = label
        while depth > 0:
            depth -= 1
            row, column = stack[depth, 0], stack[depth, 1]
            area += 1
            for r in range(max(0, row - 1), min(height, row + 2)):
                for c in range(max(0, column - 1), min(width, column + 2)):
                    if mask[r, c] == 1 and number[r, c] == 0:
                        number[r, c] = label
                        stack[depth, 0], stack[depth, 1] = r, c
                        depth += 1
        areas.append(area)
    return number, np.array(areas)
