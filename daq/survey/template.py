"""The commented survey file that ``stepdiag init`` writes, from the text file beside this
module.
"""

from importlib.resources import files


def template() -> str:
    """Return the text of a valid survey file with a comment on every field."""
    return files("stepdiag.daq.survey").joinpath("template.toml").read_text(encoding="utf-8")
