"""The exporters' cases: what they are stands in testkit.recorded, one module a call; a file holds
the cases of one group."""

from testkit.references.exporters import GROUPS, OTHERS

ABOUT = {
    "exported": "whole exports of a made-up result: files, report, figures",
    "damaged": "files of controls, damaged line by line, and how each is read or refused",
    "judged": "files that people mistake for the right ones, and what verify says of them",
    "checked": "the checks of tables around their limits",
    "tried": "sign tests: bumps, and the verdicts on runs",
    "programmed": "NC programs, and what refuses one",
    "computed": "curves, fits, angles, lattices and laws, number by number",
    "exchanged": "texts by hand: Etalon Exchange, volumetric files, punch files, lines and numbers",
    "limited": "what controls accept and ask for",
    "kept": "files and sets of files",
    "weighed": "tables weighed against what a result asks for, in ladders of sizes, shifts and "
    "mixtures",
    "served": "the register block that the component for LinuxCNC serves",
    "asked": "profiles with one field that is wrong",
}
CASES = {
    f"{call}-{group}": (f"{ABOUT[call]}: {group}", call, lambda group=group: {"group": group})
    for call, (_, groups) in GROUPS.items()
    for group in (*groups, OTHERS)
}
