"""The conclusion of a survey in a few sentences: errors, unknowns, effect of compensation, files to
load, next step.

Page, report, `status` and terminal show the conclusion, and ``conclusion.json`` contains it. All
uncertainties come from the result and from the prediction. `report`, `page`, `daemon` and `cli`
import this package.
"""

from stepdiag.conclusion.concluding import (
    Conclusion,
    Export,
    conclude,
    export_of,
    harmed_in,
    loadable,
    taken_for_granted,
)
from stepdiag.conclusion.contributions import Contribution, contributions_of
from stepdiag.conclusion.file import (
    conclusion_document,
    conclusion_in,
    conclusion_json,
    titles_of,
    words_of,
)
from stepdiag.conclusion.intervals import Reach, reach_of
from stepdiag.conclusion.sentences import Sentence, render
from stepdiag.conclusion.verdict import (
    STATES,
    even_of,
    interval_of,
    judged_in,
    probability_words,
    quantity_words,
    verdict_words,
)

__all__ = [
    "STATES",
    "Conclusion",
    "Contribution",
    "Export",
    "Reach",
    "Sentence",
    "conclude",
    "conclusion_document",
    "conclusion_in",
    "conclusion_json",
    "contributions_of",
    "even_of",
    "export_of",
    "harmed_in",
    "interval_of",
    "judged_in",
    "loadable",
    "probability_words",
    "quantity_words",
    "reach_of",
    "render",
    "taken_for_granted",
    "titles_of",
    "verdict_words",
    "words_of",
]
