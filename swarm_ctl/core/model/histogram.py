"""Percentiles of a stream in constant memory."""

from __future__ import annotations

from typing import Final


class Histogram:
    """Counts values in bins of `width` from 0; the last bin takes everything beyond. Unit: the
    caller's.

    Percentiles are upper bin edges: at most one `width` too high, never too low (but for values
    beyond the last bin).
    """

    __slots__ = ("_bins", "count", "most", "width")

    def __init__(self, width: float, bins: int = 500) -> None:
        self.width: Final = width
        self._bins = [0] * (bins + 1)
        self.count = 0
        self.most = 0.0

    def add(self, value: float) -> None:
        """Count one value; negative ones (clocks that differ) count as zero."""
        bin_ = int(value / self.width) if value > 0.0 else 0
        self._bins[bin_ if bin_ < len(self._bins) else -1] += 1
        self.count += 1
        if value > self.most:
            self.most = value

    def percentile(self, share: float) -> float | None:
        """The upper edge of the bin that holds the `share` (0..1) quantile; None before the first
        value."""
        wanted = share * self.count
        seen = 0
        for index, number in enumerate(self._bins):
            seen += number
            if number and seen >= wanted:
                return round((index + 1) * self.width, 9)
        return None
