"""A result and a profile are of the same machine, by their stated names."""

from stepdiag.base.errors import SafetyError
from stepdiag.base.messages import message
from stepdiag.base.result.result import Result
from stepdiag.exporters.tables.profile import Profile

UNANSWERED = frozenset({"", "machine", "?"})
"""Machine names of a survey file that is not answered yet."""


def require_same_machine(result: Result, profile: Profile) -> None:
    """Raise ``SafetyError`` if result and profile name different machines: a table of a machine is
    never right for another.

    Case and spaces do not matter; a result without a machine's name, and a stand-in profile, are no
    evidence.
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
    """Return whether two names are one, but for case and spaces."""
    return "".join(one.lower().split()) == "".join(other.lower().split())
