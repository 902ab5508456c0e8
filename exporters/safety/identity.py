"""Check that a result and a profile belong to the same machine, by the machine names."""

from stepdiag.base.errors import SafetyError
from stepdiag.base.messages import message
from stepdiag.base.result.result import Result
from stepdiag.exporters.tables.profile import Profile

UNANSWERED = frozenset({"", "machine", "?"})
"""Machine names of a survey file in which the question for the name is still open."""


def require_same_machine(result: Result, profile: Profile) -> None:
    """Raise ``SafetyError`` if result and profile name different machines.

    Case and spaces do not matter. A result without a machine name, and an assumed profile, are no
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
    return "".join(one.lower().split()) == "".join(other.lower().split())
