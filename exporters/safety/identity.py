"""The test whether a result and a profile belong to the same machine, by the stated names."""

from stepdiag.base.errors import SafetyError
from stepdiag.base.messages import message
from stepdiag.base.result.result import Result
from stepdiag.exporters.tables.profile import Profile

UNANSWERED = frozenset({"", "machine", "?"})
"""Machine names of a survey file whose questions are not answered yet."""


def require_same_machine(result: Result, profile: Profile) -> None:
    """Raise ``SafetyError`` if result and profile name different machines: a table of one machine
    is never right for another.

    Case and spaces do not matter; a result without a machine's name, and the stand-in for a
    profile, are no evidence.
    """
    measured = "" if result.survey is None else result.survey.machine
    if profile.assumed or measured.strip().lower() in UNANSWERED:
        return
    if not same_name(measured, profile.machine.name):
        raise SafetyError(
            f"{profile.source}: machine.name",
            code="survey-differs.machine",
            expected=message("measured-machine", name=repr(measured), file=result.source),
            found=repr(profile.machine.name),
            remedy=message("use-profile-machine-where"),
        )


def same_name(one: str, other: str) -> bool:
    """Return whether two names are equal except for case and spaces."""
    return "".join(one.lower().split()) == "".join(other.lower().split())
