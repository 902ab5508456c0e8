"""The commented survey file that ``stepdiag init`` writes.

The text is a file of its own beside this module and so readable directly.
"""

from importlib.resources import files


def template() -> str:
    """Return a survey file in which every field is documented; it is valid unchanged."""
    return files("stepdiag.daq.survey").joinpath("template.toml").read_text(encoding="utf-8")
