"""Age of a robot's state, by the robot's own clock: late is as bad as missing."""

from __future__ import annotations

_WINDOW = 10.0  # s; clocks drift apart by less than a millisecond in that time
_RATE = (0.8, 1.25)  # of a clock that counts seconds


class Ageing:
    """Age of the newest state.

    The robot's clock starts anywhere. What the fastest message of the last seconds took is no age,
    so the age of another is what it took longer. That tells messages that are delayed, which the
    time since the last arrival does not.
    """

    def __init__(self) -> None:
        """No state has come yet."""
        self._since = 0.0
        self._fastest = self._earlier = float("inf")
        self._last: tuple[float, float] | None = None
        self._first: tuple[float, float] | None = None

    def heard(self, now: float, robot_time: float) -> None:
        """Note a state that came at ``now`` and is of ``robot_time`` [s]."""
        offset = now - robot_time
        if now - self._since > _WINDOW:
            self._since, self._earlier, self._fastest = now, self._fastest, offset
        self._fastest = min(self._fastest, offset)
        self._last = (now, robot_time)
        self._first = self._first or self._last

    def age(self, now: float) -> float:
        """Of the newest state [s]; since its arrival only, if the robot's clock is of no use."""
        if self._last is None:
            return float("inf")
        arrived, robot_time = self._last
        if not self.counts():
            return now - arrived
        return now - robot_time - min(self._fastest, self._earlier)

    def counts(self) -> bool:
        """True as long as the robot's clock has counted seconds."""
        if self._first is None or self._last is None or self._last[0] - self._first[0] < 0.5:
            return True
        (begun, from_time), (now, to_time) = self._first, self._last
        return _RATE[0] < (to_time - from_time) / (now - begun) < _RATE[1]
