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
(2, k, C, C), direction, tap, input channel, output channel; results (2, s, N, E / s, C), where
place p·s + j of a slice is at index p of share j, as :func:`in_shares` sees slices.
"""

from __future__ import annotations

import torch
from torch import Tensor

LEAST_CHANNELS = 128
"""Channels from which the products saved outweigh the additions, on a CPU."""


def in_shares(slices: Tensor, shares: int) -> Tensor:
    """View of slices (any, N, E, C) in the order of results, (any, s, N, E / s, C)."""
    return slices.unflatten(2, (-1, shares)).movedim(3, 1)


class Direct:
    """All taps' neighbours side by side, one product per direction.

    Attributes:
        shares: s of the results.
    """

    shares = 1

    def __init__(self, kernels: Tensor, batch: int, extent: int) -> None:
        """Args: ``kernels`` as in the module's text; ``batch`` N and ``extent`` E of a slice."""
        two, taps, inputs, outputs = kernels.shape
        self._weight = kernels.reshape(two, taps * inputs, outputs)
        self._window = kernels.new_empty(two, batch, extent, taps * inputs)

    def reads(self, padded: Tensor) -> tuple[Tensor, ...]:
        """The views of padded slices that a step reads; made once where slices are used again."""
        # Overlapping windows: a place's neighbours lie one behind the other in memory.
        shape = self._window.shape
        return (padded.as_strided(shape, padded.stride(), padded.storage_offset()),)

    def __call__(self, reads: tuple[Tensor, ...], out: Tensor) -> None:
        """Write the filtered slices to ``out``, contiguous results as in the module's text."""
        self._window.copy_(*reads)
        torch.bmm(self._window.flatten(1, 2), self._weight, out=out.flatten(1, 3))


class Minimal:
    """F(2, 3) on each triple of taps; k must be divisible by three and E by two.

    The four products are taken in pairs, (m_1, m_2) and (m_0, −m_3): one call then makes the sums
    of a pair, in both directions at once, and the second pair's products add themselves to what
    the first pair gives both results. What a step writes and reads again is small so, and each of
    two cores keeps to one direction; on a slice this size, memory costs more than the additions.

    Attributes:
        shares: s of the results.
    """

    shares = 2

    def __init__(self, kernels: Tensor, batch: int, extent: int) -> None:
        """Args: as :class:`Direct`."""
        two, taps, inputs, outputs = kernels.shape
        triples, pairs = taps // 3, extent // 2
        first, middle, last = kernels.unflatten(1, (triples, 3)).unbind(2)
        ends = (first + last) / 2
        weights = torch.stack([ends + middle / 2, ends - middle / 2, first, -last], 1)
        self._middle, self._outer = (
            pair.reshape(two * 2, triples * inputs, outputs) for pair in weights.split(2, 1)
        )
        self._sums = kernels.new_empty(two, 2, batch, pairs, triples, inputs)
        self._rows = self._sums.view(two * 2, batch * pairs, triples * inputs)
        products = kernels.new_empty(two, 2, batch, pairs, outputs)
        self._products = products.view(two * 2, batch * pairs, outputs)
        self._m1, self._m2 = products.split(1, 1)
        self._sign = kernels.new_tensor([1, -1]).view(1, 2, 1, 1, 1)
        self._signs = self._sign.unsqueeze(5)

    def reads(self, padded: Tensor) -> tuple[Tensor, ...]:
        """As :meth:`Direct.reads`; each of shape (2, 2, N, E / 2, k / 3, C)."""
        direction, image, row, channel = padded.stride()

        def places(first: int, apart: int) -> Tensor:
            """Of every four places, ``first`` and ``first + apart``."""
            strides = (direction, apart * row, image, 2 * row, 3 * row, channel)
            return padded.as_strided(
                self._sums.shape, strides, padded.storage_offset() + first * row
            )

        return places(2, 0), places(1, 0), places(0, 1), places(2, 1)

    def __call__(self, reads: tuple[Tensor, ...], out: Tensor) -> None:
        """Write the filtered slices to ``out``, contiguous results as in the module's text."""
        x2, x1, x01, x23 = reads
        torch.addcmul(x2, x1, self._signs, out=self._sums)  # x_2 ± x_1
        torch.bmm(self._rows, self._middle, out=self._products)
        torch.addcmul(self._m1, self._m2, self._sign, out=out)  # m_1 ± m_2
        torch.sub(x01, x23, out=self._sums)  # x_0 − x_2, x_1 − x_3
        out.view(self._products.shape).baddbmm_(self._rows, self._outer)


def steps_of(kernels: Tensor, batch: int, extent: int) -> Direct | Minimal:
    """The quicker of the two where these kernels run on slices of that extent.

    A GPU is held up by the number of its kernels, not by multiplications; there it is
    :class:`Direct`, and so it is in half precision, which the transforms would cost digits.
    """
    _, taps, inputs, _ = kernels.shape
    suits = taps % 3 == 0 and extent % 2 == 0 and inputs >= LEAST_CHANNELS
    exact = kernels.dtype in (torch.float32, torch.float64)
    return (Minimal if suits and exact and kernels.is_cpu else Direct)(kernels, batch, extent)
