"""Two setups that were driven in each other's place (`solver.adjustment.exchanged`): the wrong line
of the survey file."""

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Place, message
from stepdiag.daq.survey.models import Survey


def with_line(survey: Survey, found: Finding) -> Finding:
    """Return a finding of exchanged diagonals with the wrong line of the survey file and its new
    value; any other finding unchanged.

    The finding belongs to the first pass of the first diagonal, so a person can accept this finding
    for this pass.
    """
    if found.message is None or found.message.key != "step-mismatch.names":
        return found
    first, second = (str(found.message.arguments[name]) for name in ("first", "second"))
    names = {first: second, second: first}
    order = ", ".join(f'"{names.get(name, name)}"' for name in survey.plan.setups)
    words = message(
        "step-mismatch.exchanged",
        first=first,
        second=second,
        line="plan.setups",
        value=f"[{order}]",
    )
    return finding("error", words, Place(setup=first, pass_number=1))
