"""What the program has to say about the data: a code, how serious, and the words for a person."""

from dataclasses import dataclass
from typing import Literal

Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One remark. ``code`` is stable and documented in docs/findings.md; ``text`` names the setup, pass and stop.

    Where it belongs stands beside the words too, as far as it is known: ``setup``, ``pass_number``, ``stop`` (of that pass), and the size
    of what was found. ``among`` are the passes, written ``ppp/1``, of which one is meant and the data do not say which.
    """

    code: str
    severity: Severity
    text: str
    setup: str = ""
    pass_number: int | None = None
    stop: int | None = None
    size_um: float | None = None
    among: tuple[str, ...] = ()

    def as_json(self) -> dict[str, str | int | float | list[str]]:
        """Return the JSON form of the contract: code, severity, text, and where it belongs as far as that is known."""
        place = {"setup": self.setup or None, "pass": self.pass_number, "stop": self.stop, "size_um": self.size_um}
        known: dict[str, str | int | float | list[str]] = {name: value for name, value in place.items() if value is not None}
        if self.among:
            known["among"] = list(self.among)
        return {"code": self.code, "severity": self.severity, "text": self.text, **known}
