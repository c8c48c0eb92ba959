"""A battery that drains. Pure."""

from __future__ import annotations

from dataclasses import dataclass

_FULL_V, _EMPTY_V = 12.6, 10.5
_FAILED_V = 9.0
_IDLE_A, _FLYING_A = 0.5, 9.0


@dataclass(slots=True)
class Battery:
    """A three-cell pack; voltage falls linearly with the charge used."""

    capacity_mah: float
    used_mah: float = 0.0
    current_a: float = _IDLE_A
    failed: bool = False

    @property
    def voltage_v(self) -> float:
        """Voltage under load."""
        if self.failed:
            return _FAILED_V
        left = max(0.0, 1.0 - self.used_mah / self.capacity_mah)
        return _EMPTY_V + (_FULL_V - _EMPTY_V) * left

    def percent(self) -> int:
        """Charge left, 0..100."""
        if self.failed:
            return 0
        return max(0, min(100, round(100.0 * (1.0 - self.used_mah / self.capacity_mah))))

    @property
    def left_mah(self) -> float:
        """Charge left."""
        return 0.0 if self.failed else max(0.0, self.capacity_mah - self.used_mah)

    def drain(self, dt: float, *, flying: bool, factor: float = 1.0) -> None:
        """Takes what `dt` seconds cost."""
        self.current_a = (_FLYING_A if flying else _IDLE_A) * factor
        self.used_mah += self.current_a * dt / 3.6
