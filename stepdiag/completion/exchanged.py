"""Programs that drove other diagonals (`solver.adjustment.exchanged`): the wrong line of the survey
file."""

from dataclasses import replace

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Argument, Message, Place, message, message_with
from stepdiag.daq.survey.models import Survey

NAMES = frozenset({"step-mismatch.names", "step-mismatch.programs"})
"""Messages of the solver about other diagonals."""


def with_line(survey: Survey, found: Finding) -> Finding:
    """Return a finding of diagonals with other names with the wrong line of the survey file and its
    new value; any other finding, and a finding of a diagonal driven twice, unchanged.

    The place of a sure finding is the first pass of the first diagonal, where a person can accept
    it.
    """
    words = found.message
    suspects = () if words is None else words.arguments.get("suspects", ())
    likely = suspects[0] if isinstance(suspects, tuple) and suspects else words
    if words is None or words.key not in NAMES or not isinstance(likely, Message):
        return found
    setups, driven = (_names(likely.arguments[name]) for name in ("setups", "driven"))
    if set(setups) != set(driven):
        return found
    names = dict(zip(setups, driven, strict=True))
    value = ", ".join(f'"{names.get(name, name)}"' for name in survey.plan.setups)
    line = {"line": "plan.setups", "value": f"[{value}]"}
    if suspects:
        asked = message_with("step-mismatch.order", {"suspects": suspects, **line})
        return replace(finding("error", asked), among=found.among)
    sure = message("step-mismatch.exchanged", setups=setups, driven=driven, **line)
    return finding("error", sure, Place(setup=setups[0], pass_number=1))


def _names(argument: Argument) -> list[str]:
    return [str(each) for each in argument] if isinstance(argument, tuple) else []
