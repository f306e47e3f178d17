"""One step of message passing: the k-tap filters of both directions, as matrix products.

Two ways to the same sums. :class:`Direct` copies each place's k neighbours side by side and
multiplies once. :class:`Minimal` saves a third of the multiplications by minimal filtering
F(2, 3) (Winograd 1980; Lavin and Gray 2016): two neighbouring results of a three-tap filter
take four products instead of six,

    m_0 = (x_0 − x_2) g_0                    y_0 = m_0 + m_1 + m_2
    m_1 = (x_1 + x_2) (g_0 + g_1 + g_2) / 2  y_1 = m_1 − m_2 − m_3
    m_2 = (x_2 − x_1) (g_0 − g_1 + g_2) / 2
    m_3 = (x_1 − x_3) g_2

and a filter of k taps is k / 3 of these, whose sum over triples the matrix product takes with it.
Its transforms only add, so single precision loses next to nothing; wider tiles would.

Shapes: padded slices (2, N, E + k − 1, C), first index the direction of travel; kernels
(2, k, C, C), direction, tap, input channel, output channel; results (2, N, E, C).
"""

from __future__ import annotations

import torch
from torch import Tensor

LEAST_CHANNELS = 128
"""Channels from which the products saved outweigh the additions, on a CPU."""


class Direct:
    """All taps' neighbours side by side, one product per direction."""

    def __init__(self, kernels: Tensor, batch: int, extent: int) -> None:
        """Args: ``kernels`` as in the module's text; ``batch`` N and ``extent`` E of a slice."""
        two, taps, inputs, outputs = kernels.shape
        self._taps = taps
        self._weight = kernels.reshape(two, taps * inputs, outputs)
        self._window = kernels.new_empty(two, batch, extent, taps * inputs)

    def __call__(self, padded: Tensor, out: Tensor) -> None:
        """Write the filtered slices to ``out``, whose batch and extent must be one stretch."""
        window = self._window
        # Overlapping windows: a place's neighbours lie one behind the other in memory.
        window.copy_(padded.as_strided(window.shape, padded.stride(), padded.storage_offset()))
        torch.bmm(window.flatten(1, 2), self._weight, out=out.flatten(1, 2))


class Minimal:
    """F(2, 3) on each triple of taps; k must be divisible by three and E by two."""

    def __init__(self, kernels: Tensor, batch: int, extent: int) -> None:
        """Args: as :class:`Direct`."""
        two, taps, inputs, outputs = kernels.shape
        triples, pairs = taps // 3, extent // 2
        first, middle, last = kernels.unflatten(1, (triples, 3)).unbind(2)
        ends = (first + last) / 2
        weight = torch.stack([first, ends + middle / 2, ends - middle / 2, last])
        self._weight = weight.reshape(4 * two, triples * inputs, outputs)
        sums = kernels.new_empty(4, two, batch, pairs, triples, inputs)
        products = kernels.new_empty(4, two, batch, pairs, outputs)
        self._shape = sums.shape[1:]
        # Views, made once: a step takes a few hundred microseconds, a view one or two.
        self._sums, self._products = sums.unbind(), products.unbind()
        self._rows = sums.view(4 * two, batch * pairs, triples * inputs)
        self._results = products.view(4 * two, batch * pairs, outputs)
        self._between = torch.empty_like(self._products[0])

    def __call__(self, padded: Tensor, out: Tensor) -> None:
        """Write the filtered slices to ``out``."""
        direction, image, row, channel = padded.stride()
        strides = (direction, image, 2 * row, 3 * row, channel)  # as (2, N, E / 2, k / 3, C)
        start = padded.storage_offset()
        x0, x1, x2, x3 = (
            padded.as_strided(self._shape, strides, start + i * row) for i in range(4)
        )
        s0, s1, s2, s3 = self._sums
        torch.sub(x0, x2, out=s0)
        torch.add(x1, x2, out=s1)
        torch.sub(x2, x1, out=s2)
        torch.sub(x1, x3, out=s3)
        torch.bmm(self._rows, self._weight, out=self._results)
        m0, m1, m2, m3 = self._products
        y0, y1 = out.unflatten(2, (-1, 2)).unbind(3)
        torch.add(m0, torch.add(m1, m2, out=self._between), out=y0)
        torch.sub(torch.sub(m1, m2, out=self._between), m3, out=y1)


def steps_of(kernels: Tensor, batch: int, extent: int) -> Direct | Minimal:
    """The quicker of the two where these kernels run on slices of that extent.

    A GPU is held up by the number of its kernels, not by multiplications; there it is
    :class:`Direct`, and so it is in half precision, which the transforms would cost digits.
    """
    _, taps, inputs, _ = kernels.shape
    suits = taps % 3 == 0 and extent % 2 == 0 and inputs >= LEAST_CHANNELS
    exact = kernels.dtype in (torch.float32, torch.float64)
    return (Minimal if suits and exact and kernels.is_cpu else Direct)(kernels, batch, extent)
