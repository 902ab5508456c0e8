"""What the program has to say about the data: a code, how serious, and the words for a person."""

from dataclasses import dataclass
from typing import Literal

Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One remark. ``code`` is stable and documented in docs/findings.md; ``text`` names the setup, pass and stop."""

    code: str
    severity: Severity
    text: str

    def as_json(self) -> dict[str, str]:
        """Return the JSON form of the contract: code, severity, text."""
        return {"code": self.code, "severity": self.severity, "text": self.text}
