"""Programs that drove other diagonals (`solver.adjustment.exchanged`): the wrong line of the survey
file."""

from dataclasses import replace

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Place, message
from stepdiag.daq.survey.models import Survey


def with_line(survey: Survey, found: Finding) -> Finding:
    """Return a finding of diagonals with other names with the wrong line of the survey file and its
    new value; any other finding, and a finding of a diagonal driven twice, unchanged.

    The place of a sure finding is the first pass of the first diagonal, where a person can accept
    it.
    """
    words = found.message
    if words is None or words.key not in ("step-mismatch.names", "step-mismatch.programs"):
        return found
    open_names = words.key == "step-mismatch.programs"
    named = words.arguments["suspects"][0].arguments if open_names else words.arguments
    names = dict(zip(named["setups"], named["driven"], strict=True))
    if set(names) != set(names.values()):
        return found
    order = ", ".join(f'"{names.get(name, name)}"' for name in survey.plan.setups)
    line = {"line": "plan.setups", "value": f"[{order}]"}
    if open_names:
        asked = message("step-mismatch.order", suspects=words.arguments["suspects"], **line)
        return replace(finding("error", asked), among=found.among)
    sure = message("step-mismatch.exchanged", **named, **line)
    return finding("error", sure, Place(setup=next(iter(names)), pass_number=1))
