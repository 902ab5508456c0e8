"""The commented survey file that ``stepdiag init`` writes.

It stands as a file of its own beside this module so that a person can read it as what it is.
"""

from importlib.resources import files


def template() -> str:
    """Return a survey file in which every field is documented; it is valid as it stands."""
    return files("stepdiag.daq.survey").joinpath("template.toml").read_text(encoding="utf-8")
