"""The conclusion as a file beside the result, with its sentences in every language. The same
conclusion gives the same bytes."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stepdiag.base.result.rounding import steady
from stepdiag.conclusion.concluding import Conclusion
from stepdiag.conclusion.sentences import SECTION, Sentence, render
from stepdiag.daq.records.survey_folder import CONCLUSION
from stepdiag.texts import LANGUAGES, Language, catalogue

FORMAT, FORMAT_VERSION = "stepdiag-conclusion", 1
SECTIONS = ("reached", "verdict", "wrong", "unknown", "load", "next_step", "basis")
"""The sections of a conclusion in the order of reading."""


def conclusion_document(
    conclusion: Conclusion, field: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return a conclusion as plain data: sentences in every language, the predicted volumetric
    error in um (k = 2), and the error ``field`` for the picture."""
    return {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "wrong": [
            {**_contribution(one), **_words(sentence)} for one, sentence in conclusion.wrong
        ],
        "unknown": [_words(one) for one in conclusion.unknown],
        "reached": [_words(one) for one in conclusion.reached],
        **(
            {"verdict": [_words(one) for one in conclusion.verdict]}
            if conclusion.verdict
            else {}
        ),
        "basis": [_words(one) for one in conclusion.basis],
        "load": [_words(one) for one in conclusion.load],
        "next_step": [_words(conclusion.next_step)],
        "reach": None if conclusion.reach is None else _rounded(asdict(conclusion.reach)),
        "findings": conclusion.findings,
        "field": None if field is None else _rounded(dict(field)),
    }


def conclusion_json(conclusion: Conclusion, field: Mapping[str, Any] | None = None) -> str:
    return (
        json.dumps(
            conclusion_document(conclusion, field), ensure_ascii=False, allow_nan=False
        )
        + "\n"
    )


def titles_of(language: Language) -> dict[str, str]:
    words = catalogue(SECTION, language)
    return {section: words[section] for section in SECTIONS}


def words_of(document: Mapping[str, Any], language: Language) -> dict[str, list[str]]:
    # Files of older versions have no section for the basis.
    # Surveys without a tolerance have no section for the verdict.
    return {
        section: [sentence[language] for sentence in document.get(section, [])]
        for section in SECTIONS
    }


def conclusion_in(folder: Path) -> dict[str, Any] | None:
    """Return the JSON of the conclusion in a survey's folder, or None if the conclusion is missing
    or has another version."""
    try:
        document = json.loads((folder / CONCLUSION).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    known = isinstance(document, dict) and (
        document.get("format"),
        document.get("version"),
    ) == (
        FORMAT,
        FORMAT_VERSION,
    )
    return document if known else None


def _contribution(one: Any) -> dict[str, Any]:
    return {
        "name": one.name,
        "kind": one.kind,
        "effect_um": steady(one.effect_um, 4),
        "u_um": None if one.u_um is None else steady(one.u_um, 4),
    }


def _words(sentence: Sentence) -> dict[str, str]:
    return {language: render(sentence, language) for language in LANGUAGES}


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {
            key: _rounded(item)
            for key, item in value.items()
            if key != "within" or item is not None
        }
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return steady(value, 4) if isinstance(value, float) else value
