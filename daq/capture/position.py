"""The commanded position of a stop, as the machine gives it, against the plan."""

from stepdiag.daq.capture.walk import Walk
from stepdiag.daq.formats.signals import SignalMap, Signals, resolution
from stepdiag.solver.findings import Finding, Severity

ROUNDED_UM = 1.0
"""A program written to three decimals is off by half of that: worth a note. More is worth a look at the program."""
AGAIN = 1.5
"""A difference is said again where it is larger by so much than what was said of the pass before."""


class PositionCheck:
    """Compares stop by stop and says each pass what is new. The machine's word counts, the readings carry it."""

    def __init__(self, signals: SignalMap) -> None:
        self._signals = signals
        self._said: dict[str, float] = {}

    def judge(self, walk: Walk, stop: int, signals: Signals) -> list[Finding]:
        """Return what is to be said of the commanded position at a stop; nothing where the register cannot tell it from the plan's."""
        if signals.commanded_mm is None:
            return []
        rows = zip("xyz", signals.commanded_mm, walk.route.planned_mm(stop), strict=True)
        beyond = [(abs(here - plan), axis, here, plan) for axis, here, plan in rows if abs(here - plan) > self._resolution_mm(axis, plan)]
        off_mm, axis, here, plan = max(beyond, default=(0.0, "", 0.0, 0.0))
        if off_mm <= AGAIN * self._said.get(walk.name, 0.0):
            return []
        self._said[walk.name] = off_mm
        text = (
            f"the machine is commanded to {axis.upper()} {here:.4f} mm, the plan has {plan:.4f} mm ({(here - plan) * 1e3:+.1f} um): "
            "the machine's position counts"
        )
        severity: Severity = "info" if off_mm * 1e3 <= ROUNDED_UM else "warning"
        return [walk.finding("position-differs", severity, stop, text)]

    def _resolution_mm(self, axis: str, value_mm: float) -> float:
        spec = self._signals.get(f"{axis}_mm")
        return 0.0 if spec is None else resolution(spec, value_mm)
