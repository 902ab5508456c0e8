"""The exporters' cases: what they are stands in testkit.recorded, one module a call; a file holds the cases of one group."""

from testkit.references.exporters import GROUPS, OTHERS

ABOUT = {
    "exported": "whole exports of a made-up result: files, report, figures",
    "damaged": "files of controls, damaged line by line, and how each is read or refused",
    "judged": "files that people mistake for the right ones, and what verify says of them",
    "checked": "the checks of tables around their limits",
    "tried": "sign tests: bumps, and the verdicts on runs",
    "programmed": "NC programs, and what refuses one",
    "asked": "profiles with one field that is wrong",
}
CASES = {
    f"{call}-{group}": (f"{ABOUT[call]}: {group}", call, lambda group=group: {"group": group})
    for call, (_, groups) in GROUPS.items() for group in (*groups, OTHERS)
}  # fmt: skip
